#pragma once

#include <map>
#include <string>

#include "peers.hpp"

namespace asterism::bench {

// Each is in its own file, which is left out of builds without the library.
void add_opencv_peers(std::map<std::string, Start>& peers);
void add_dlib_peers(std::map<std::string, Start>& peers);
// NanoTrack (github.com/HonglinChu/SiamTrackers), with the networks backbone.onnx and head.onnx of a folder.
// Throws std::invalid_argument if they are missing, cannot be read, or are not those of NanoTrack.
Start nanotrack_peer(const std::string& folder);

}  // namespace asterism::bench
