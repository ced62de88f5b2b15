#include <asterism/solver/io/json.hpp>
#include <asterism/system.hpp>
#include <fstream>
#include <iostream>
#include <stdexcept>

int main() {
  asterism::System system(3, 2);
  const Eigen::MatrixXd seen{{0, 12.5, 6}, {0, 0, 9}};
  system.add_anchors(seen, Eigen::Vector3d(1, 0.5, 0.01));
  system.add_links(asterism::all_pairs(3), asterism::System::all(10), asterism::System::all(2))
      .set_loss(asterism::Loss::Huber, 3);
  std::ofstream file("terms.jsonl");
  asterism::write_stored_terms(file, {system, seen, "a triangle", R"({"frame": 17})"});  // appends a line
  file.close();

  try {
    for (asterism::StoredTerms& stored : asterism::read_stored_terms("terms.jsonl"))  // of both versions
      std::cout << stored.name << ": " << asterism::solve(stored.system, stored.start).status << "\n";
  } catch (const std::runtime_error& error) {  // terms.jsonl:1: terms[1]: unknown key "lenght"
    std::cerr << error.what() << "\n";
    return 1;
  }
}
