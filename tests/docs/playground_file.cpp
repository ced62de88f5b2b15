#include "playground_file.hpp"

#include <asterism/solver/io/json.hpp>

PlaygroundFile read_playground_file(const std::string& path) {
  const auto stored = asterism::read_systems<asterism::SpringSystem<double, 2>>(path).at(0);
  const auto& system = stored.system;
  const auto numbers = [](const auto& values) {
    return std::vector<double>(values.data(), values.data() + values.size());
  };
  PlaygroundFile file{numbers(system.anchors),
                      numbers(stored.start),
                      numbers(system.anchor_stiffness),
                      numbers(system.rest_length),
                      numbers(system.link_stiffness),
                      {},
                      {},
                      asterism::to_json(stored)};
  for (const asterism::Link& link : system.links()) file.links.emplace_back(link.i, link.j);
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) file.fixed.push_back(i);
  }
  return file;
}
