#include "playground_file.hpp"

#include <asterism/solver/io/json.hpp>
#include <variant>

PlaygroundFile read_playground_file(const std::string& path) {
  const auto numbers = [](const auto& values) {
    return std::vector<double>(values.data(), values.data() + values.size());
  };
  const auto read = [&](const auto& stored) {
    const auto& system = stored.system;
    PlaygroundFile file{static_cast<int>(stored.start.rows()),
                        numbers(system.anchors),
                        numbers(stored.start),
                        numbers(system.anchor_stiffness),
                        numbers(system.rest_length),
                        numbers(system.link_stiffness),
                        {},
                        {},
                        asterism::to_json(stored)};
    for (const asterism::Link& link : system.links()) file.ends.insert(file.ends.end(), {link.i, link.j});
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.is_fixed(i)) file.fixed.push_back(i);
    }
    return file;
  };
  return std::visit(read, asterism::read_systems(path).at(0));
}
