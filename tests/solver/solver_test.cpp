// IDA and nonlinear CG have the guarantees of every solver; and the texts of a Summary.
#include <gtest/gtest.h>

#include "every_solver.hpp"

#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

#include <sstream>
#include <string>
#include <string_view>

namespace asterism {
namespace {

template <typename System>
using AnalyticCg = NonlinearCg<System>;

const bool kRegistered = [] {
#ifdef ASTERISM_TEST_CHOLMOD
  register_solvers<Dynamic2>("plane", {solver_kind<CholmodIda, Dynamic2>()});
  register_solvers<Bounded3f>("bounded space, float", {solver_kind<CholmodIda, Bounded3f>()});
#endif
  register_solvers<Fixed2>("4 nodes", {solver_kind<AnalyticCg, Fixed2>(), solver_kind<DenseIda, Fixed2>()});
  register_solvers<Dynamic2>("plane", {solver_kind<SparseIda, Dynamic2>()});
  register_solvers<Dynamic3>("space",
                             {solver_kind<AnalyticCg, Dynamic3>(), solver_kind<DenseIda, Dynamic3>()});
  register_solvers<Fixed2f>("4 nodes, float",
                            {solver_kind<SparseIda, Fixed2f>(), solver_kind<DenseIda, Fixed2f>()});
  register_solvers<Bounded3f>("bounded space, float",
                              {solver_kind<AnalyticCg, Bounded3f>(), solver_kind<DenseIda, Bounded3f>()});
  return true;
}();

TEST(SummaryText, SaysWhatHappened) {
  EXPECT_EQ(Summary().status, Status::NotRun);
  EXPECT_EQ(Summary().iterations, -1);
  EXPECT_FALSE(Summary().usable());
  EXPECT_EQ(to_string(Status::InvalidInput), "invalid input");

  SpringSystem<double, 2> system(Topology<>::full(2));
  system.anchors << 0, 1, 0, 0;
  system.anchor_stiffness.setOnes();
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setOnes();
  Eigen::Matrix2Xd x = system.anchors;
  std::ostringstream text;
  text << solve_ida(system, x);
  EXPECT_NE(text.str().find("converged after 0 iterations"), std::string::npos) << text.str();
  text.str("");
  system.rest_length[0] = -1;
  text << solve_ida(system, x);
  EXPECT_EQ(text.str(), "IDA, dense Cholesky: invalid input (rest length 0 is negative or not finite)");
}

TEST(SummaryText, MessagesAreCutOffNotOverrun) {
  const std::string longest(1000, 'a');
  Message message{std::string_view(longest)};
  message.append("b").append(7);
  EXPECT_LT(std::string_view(message).size(), 200u);
  EXPECT_EQ(std::string_view(message).find_first_not_of('a'), std::string_view::npos);
}

}  // namespace
}  // namespace asterism
