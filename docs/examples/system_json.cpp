#include <asterism/solver.hpp>
#include <asterism/solver/io/json.hpp>
#include <fstream>
#include <iostream>

int main() {
  asterism::SpringSystem<double, 2> system(asterism::Topology<>::full(3));
  system.anchors << 0, 12.5, 6, 0, 0, 9;
  system.anchor_stiffness << 1, 0.5, 0.01;
  system.rest_length.setConstant(10);
  system.link_stiffness.setConstant(2);
  std::ofstream file("hard.jsonl");
  asterism::write_system(file, system, system.anchors, "two minima", R"({"frame": 17})");  // appends a line
  file.close();

  try {
    // Systems of any dimension; read_systems<System>(path) reads those of one type.
    for (asterism::AnyStoredSystem& any : asterism::read_systems("hard.jsonl")) {
      std::visit([](auto& s) { std::cout << s.name << ": " << asterism::solve(s.system, s.start) << "\n"; },
                 any);
    }
  } catch (const std::runtime_error& e) {  // hard.jsonl:1: links[4] joins a node to itself
    std::cerr << e.what() << "\n";
    return 1;
  }
}
