#pragma once

#include <map>
#include <string>

#include "peers.hpp"

namespace asterism::bench {

// Each in a file of its own that is left out where the library is not there.
void add_opencv_peers(std::map<std::string, Start>& peers);
void add_dlib_peers(std::map<std::string, Start>& peers);

}  // namespace asterism::bench
