#pragma once

#include <map>
#include <string>

#include "peers.hpp"

namespace asterism::bench {

// Each is in its own file, which is left out of builds without the library.
void add_opencv_peers(std::map<std::string, Start>& peers);
void add_dlib_peers(std::map<std::string, Start>& peers);

}  // namespace asterism::bench
