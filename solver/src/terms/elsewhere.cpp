#include <algorithm>
#include <asterism/solver/terms/registry.hpp>
#include <iterator>

namespace asterism {
inline namespace ASTERISM_ABI {

std::string method_elsewhere(std::string_view letters, const std::vector<std::string>& known) {
  // Names between blanks: methods of other libraries, what serves the same purpose here, and the reference
  // solvers that some builds have.
  struct Row {
    std::string_view theirs, ours, references;
  };
  static constexpr Row kRows[] = {
      {" levenbergmarquardt lm levmar gaussnewton dogleg trustncg trustregion trustexact trustkrylov trf "
       "hybr ",
       "'newton' for small systems, 'newton-cg' for large ones", " ceres-dense ceres-sparse "},
      {" bfgs lbfgsb quasinewton ", "'lbfgs'", " ceres-lbfgs liblbfgs "},
      {" tnc truncatednewton newtonkrylov ", "'newton-cg'", ""},
      {" cg conjugategradient nonlinearcg fletcherreeves polakribiere ", "'ncg'", " ceres-cg "},
      {" smacof majorization majorisation localglobal arap ", "'ida'", ""},
      {" gnc gncoptimizer graduatednonconvexity ", "'graduated'", ""},
      {" basinhopping differentialevolution dualannealing shgo brute global ",
       "'multi-start', or 'staircase' for a lower bound of the energy", ""},
      {" default best any ", "'auto'", ""},
      {" kamadakawai stress neato spring fruchtermanreingold forceatlas2 sfdp ",
       "the default, with which layout minimises the stress as Kamada and Kawai do", ""},
      {" ceres ", "'auto'", " ceres-sparse ceres-dense ceres-lbfgs ceres-cg "},
      {" cholmod ", "a sparse method", " ida-cholmod newton-cholmod "}};
  const auto has = [](std::string_view words, std::string_view word) {
    std::string key(1, ' ');
    key.append(word).push_back(' ');
    return words.find(key) != std::string_view::npos;
  };
  const auto* const row = std::find_if(std::begin(kRows), std::end(kRows),
                                       [&](const Row& each) { return has(each.theirs, letters); });
  if (row == std::end(kRows)) return {};
  std::string answer(row->ours);
  for (const std::string& method : known) {
    if (!has(row->references, method)) continue;
    answer.append(answer.size() == row->ours.size() ? "; as a reference: '" : " or '")
        .append(method)
        .push_back('\'');
  }
  return answer;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
