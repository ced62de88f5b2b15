#pragma once

#include <string>
#include <utility>
#include <vector>

/// The first system of a file in plain numbers: playground_native.cpp is compiled without vector
/// instructions, and so cannot share types of Eigen with the library that reads it.
struct PlaygroundFile {
  std::vector<double> anchors, start;  ///< x and y of each node
  std::vector<double> anchor_stiffness, rest_length, link_stiffness;
  std::vector<std::pair<int, int>> links;
  std::vector<int> fixed;
  std::string written;  ///< as the library writes it
};

/// Throws std::runtime_error.
PlaygroundFile read_playground_file(const std::string& path);
