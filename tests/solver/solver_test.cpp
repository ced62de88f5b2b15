// IDA and nonlinear CG by what every solver promises, and the texts of a Summary.
#include "every_solver.hpp"

#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/cholmod.hpp>
#endif

#include <sstream>
#include <string>
#include <string_view>

namespace asterism {
namespace {

template <typename System>
using AnalyticCg = NonlinearCg<System>;

using Cases = ::testing::Types<
#ifdef ASTERISM_TEST_CHOLMOD
    Case<CholmodIda, Dynamic2>, Case<CholmodIda, Bounded3f>,
#endif
    Case<SparseIda, Dynamic2>, Case<SparseIda, Fixed2f>, Case<AnalyticCg, Fixed2>, Case<AnalyticCg, Dynamic3>,
    Case<AnalyticCg, Bounded3f>, Case<DenseIda, Fixed2>, Case<DenseIda, Dynamic3>, Case<DenseIda, Fixed2f>,
    Case<DenseIda, Bounded3f>>;
INSTANTIATE_TYPED_TEST_SUITE_P(Ida, EverySolver, Cases);

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
