#pragma once

#include <asterism/solver/config.hpp>
#include <cstddef>
#include <initializer_list>
#include <string_view>
#include <type_traits>

namespace asterism::inline ASTERISM_ABI {

class AnyPart;

/// Sees the options of a part model or a tracker one by one, each with its name: reads them, or lists them. A
/// model of one's own is given names by a function beside its options, found by argument-dependent lookup:
///
///     void visit_options(OptionVisitor& visit, MyOptions& options) {
///       visit("learning_rate", options.learning_rate);
///     }
///
/// What an option's name stands for must not be visited twice.
class OptionVisitor {
 public:
  virtual ~OptionVisitor() = default;

  /// A number or a switch.
  virtual void operator()(std::string_view name, double& value) = 0;
  virtual void operator()(std::string_view name, int& value) = 0;
  virtual void operator()(std::string_view name, bool& value) = 0;
  /// A part that is made as PartRegistry::make does; `model`: what it is now.
  virtual void operator()(std::string_view name, AnyPart& part, std::string_view model) = 0;
  /// An enumeration whose values are 0, 1, ..., and their names.
  template <typename E>
  requires std::is_enum_v<E>
  void operator()(std::string_view name, E& value, std::initializer_list<std::string_view> names) {
    value = static_cast<E>(choose(name, static_cast<std::size_t>(value), names));
  }
  /// Options that contain options, which have a `visit_options` of their own.
  template <typename Options>
  requires std::is_class_v<Options>
  void operator()(std::string_view name, Options& options) {
    enter(name);
    visit_options(*this, options);
    leave();
  }

 protected:
  /// For visitors alone.
  OptionVisitor() = default;
  OptionVisitor(const OptionVisitor&) = default;
  OptionVisitor& operator=(const OptionVisitor&) = default;

 private:
  virtual std::size_t choose(std::string_view name, std::size_t value,
                             std::initializer_list<std::string_view> names) = 0;
  virtual void enter(std::string_view name) = 0;
  virtual void leave() = 0;
};

}  // namespace asterism::inline ASTERISM_ABI
