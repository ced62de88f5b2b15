#include "bars.hpp"

#include <cstdio>

namespace asterism::bench {

void Bars::line(const std::string& name, const std::string& measured, const std::string& bar,
                const std::string& aim, bool met, bool aim_met) {
  const char* verdict = !met ? "NOT MET" : aim_met && aim != "-" ? "met, and the goal" : "met";
  std::printf("%-46s %-42s %-22s %-14s %s\n", name.c_str(), measured.c_str(), bar.c_str(), aim.c_str(),
              bar == "-" ? "" : verdict);
  std::fflush(stdout);
  missed_ += !met;
}

// All callers pass literals as patterns.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
void Bars::at_most(const std::string& name, const char* pattern, double measured, double bar, double aim) {
  line(name, format(pattern, measured), "<= " + format(pattern, bar), format(pattern, aim), measured <= bar,
       measured <= aim);
}

void Bars::at_least(const std::string& name, const char* pattern, double measured, double bar, double aim) {
  line(name, format(pattern, measured), ">= " + format(pattern, bar), format(pattern, aim), measured >= bar,
       measured >= aim);
}
#pragma GCC diagnostic pop

void Bars::times_faster(const std::string& name, double seconds, double other_seconds, double bar,
                        double aim) {
  const double ratio = other_seconds / seconds;
  line(name, format("%.3g x (%.3g us against %.3g us)", ratio, 1e6 * seconds, 1e6 * other_seconds),
       format(">= %g x", bar), format("%g x", aim), ratio >= bar, ratio >= aim);
}

}  // namespace asterism::bench
