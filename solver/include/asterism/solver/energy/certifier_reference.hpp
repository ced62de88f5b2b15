#pragma once

#include <asterism/solver/base/config.hpp>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#ifdef __cpp_rtti
#include <typeinfo>
#endif

namespace asterism {
inline namespace ASTERISM_ABI {

template <typename System, typename SparseFactor>
class Certifier;

/// The energy of a placement, and what the energy of any other is at least.
struct EnergyBounds {
  double energy = 0;  ///< E(x)
  double least = 0;   ///< of all placements, proven
};

/// A reference to a Certifier of any type of systems that lives as long as the solve. See
/// SolverOptions::certifier. Solvers know a certifier by this reference alone, so that those who ask for no
/// proof do not compile one.
class CertifierReference {
 public:
  /// None.
  constexpr CertifierReference() = default;
  /// Takes a named one only: a reference to a temporary would dangle.
  template <typename System, typename SparseFactor>
  CertifierReference(Certifier<System, SparseFactor>& certifier)
      : certifier_(std::addressof(certifier)),
        certify_(&certify<System, SparseFactor>),
        system_(name_of<System>()) {}

  /// Whether there is one.
  explicit operator bool() const { return certifier_ != nullptr; }
  /// Whether there is one, for systems of this type.
  template <typename System>
  bool serves() const {
    return system_ == name_of<System>();
  }
  /// The bounds that it proves of x, if any, with `gap` as its tolerance. It must serve this type of systems.
  template <typename System>
  std::optional<EnergyBounds> operator()(const System& system, const typename System::Points& x,
                                         double gap) const {
    return certify_(certifier_, &system, &x, gap);
  }

 private:
  template <typename System, typename SparseFactor>
  static std::optional<EnergyBounds> certify(void* by, const void* system, const void* x, double gap) {
    return static_cast<Certifier<System, SparseFactor>*>(by)->bounds(
        *static_cast<const System*>(system), *static_cast<const typename System::Points*>(x), gap);
  }

  // The same in every library of a program.
  template <typename System>
  static constexpr std::string_view name_of() {
#ifdef __cpp_rtti
    return typeid(System).name();
#else
    return __PRETTY_FUNCTION__;
#endif
  }

  void* certifier_ = nullptr;
  std::optional<EnergyBounds> (*certify_)(void*, const void*, const void*, double) = nullptr;
  std::string_view system_;
};

/// Has a certifier for as long as it lives. A copy that was made before the first call has its own.
using CertifierSource = std::function<CertifierReference()>;

}  // namespace ASTERISM_ABI
}  // namespace asterism
