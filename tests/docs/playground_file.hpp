#pragma once

#include <string>
#include <vector>

/// The first system of a file in plain numbers: playground_native.cpp is compiled without vector
/// instructions, and so cannot share types of Eigen with the library that reads it.
struct PlaygroundFile {
  int dim;                             ///< 2 or 3
  std::vector<double> anchors, start;  ///< the coordinates of each node
  std::vector<double> anchor_stiffness, rest_length, link_stiffness;
  std::vector<int> ends;  ///< of each link: two nodes
  std::vector<int> fixed;
  std::string written;  ///< as the library writes it
};

/// Throws std::runtime_error.
PlaygroundFile read_playground_file(const std::string& path);
