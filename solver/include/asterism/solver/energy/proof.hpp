#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/problem/message.hpp>
#include <limits>
#include <ostream>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The strongest statement that is proven about a placement.
enum class Proof {
  UniqueGlobalMinimum,  ///< its energy is the least there is, to the tolerance, and there is one minimum that
                        ///< has it, within Certificate::distance
  GlobalMinimum,        ///< its energy is the least there is, to the tolerance
  ReweightedMinimum,    ///< the same for the system whose anchors are springs with the weights that their
                        ///< loss has at x; nothing is proven about the system itself
  NotCertified,         ///< nothing: x may be the global minimum or not
  NotApplicable         ///< there is no certificate for such a system or x
};

constexpr std::string_view to_string(Proof proof) {
  switch (proof) {
    case Proof::UniqueGlobalMinimum:
      return "unique global minimum";
    case Proof::GlobalMinimum:
      return "global minimum";
    case Proof::ReweightedMinimum:
      return "global minimum of the reweighted system";
    case Proof::NotCertified:
      return "not certified";
    case Proof::NotApplicable:
      return "not applicable";
  }
  return "unknown proof";
}

inline std::ostream& operator<<(std::ostream& out, Proof proof) { return out << to_string(proof); }

/// Options of certify.
struct CertifyOptions {
  /// A global minimum may lie below E(x) by this share of E(x), or of 1e-10 sum k_ij (r_ij + mu_ij)^2 / 2 if
  /// that is more, which is for placements without strain [ratio]. With loads, whose energy depends on the
  /// origin, E(x) stands here for the springs' energy and the sum of tension times length over the links. A
  /// solver's default tolerance leaves far less.
  double gap = 1e-6;

  /// The first problem of the options, or nullptr if there is none.
  constexpr const char* problem() const {
    return gap >= 0 && detail::is_finite(gap) ? nullptr : "option gap is negative or not finite";
  }
};

/// The result of certify. Every number is rigorous: the rounding of its computation is accounted for.
struct Certificate {
  Proof proof = Proof::NotApplicable;                        ///< the verdict
  Message reason;                                            ///< why no more is proven
  double energy = std::numeric_limits<double>::quiet_NaN();  ///< E(x); NaN where it was not computed
  double lower_bound = 0;  ///< E is no lower than this anywhere; -infinity if loads leave it unknown
  /// A bound of W's least eigenvalue, see certify: from below where W is positive definite, else from above
  /// (so that W is proven indefinite where it is negative), NaN if unknown.
  double least_eigenvalue = std::numeric_limits<double>::quiet_NaN();
  /// No global minimum has a node farther from x than this [px]; infinity where that is not known.
  double distance = std::numeric_limits<double>::infinity();

  /// Whether x is proven to be a global minimum.
  bool certified() const { return proof == Proof::UniqueGlobalMinimum || proof == Proof::GlobalMinimum; }
  /// E(x) is above the least energy by no more than this share of E(x), which with loads depends on the
  /// origin; the difference of the energies where E(x) is not above 0.
  double gap() const { return (energy - lower_bound) / (energy > 0 ? energy : 1); }
};

inline std::ostream& operator<<(std::ostream& out, const Certificate& certificate) {
  out << certificate.proof;
  if (certificate.proof != Proof::NotApplicable)
    out << ", energy " << certificate.energy << ", lower bound " << certificate.lower_bound;
  if (!certificate.reason.empty()) out << " (" << certificate.reason << ")";
  return out;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
