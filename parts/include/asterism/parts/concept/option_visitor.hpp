#pragma once

#include <asterism/solver/detail/config.hpp>
#include <cstddef>
#include <initializer_list>
#include <limits>
#include <string_view>
#include <type_traits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

class AnyPart;

/// What a number may be, both ends included; NaN is never.
struct OptionRange {
  double least = -std::numeric_limits<double>::infinity();  ///< The least value taken.
  double most = std::numeric_limits<double>::infinity();    ///< The greatest value taken.
};

/// Sees the options of a part model or a tracker one by one, each with its name: reads them, or lists them. A
/// model of one's own is given names by a function beside its options, found by argument-dependent lookup:
///
///     void visit_options(OptionVisitor& visit, MyOptions& options) {
///       visit("learning_rate", options.learning_rate, {0, 1});
///     }
///
/// The range of a number may be left out. What is in all ranges should be done in seconds and megabytes.
/// What an option's name stands for must not be visited twice.
class OptionVisitor {
 public:
  virtual ~OptionVisitor() = default;

  /// A number or a switch.
  void operator()(std::string_view name, double& value) { (*this)(name, value, OptionRange()); }
  void operator()(std::string_view name, int& value) { (*this)(name, value, OptionRange()); }
  virtual void operator()(std::string_view name, double& value, const OptionRange& range) = 0;
  virtual void operator()(std::string_view name, int& value, const OptionRange& range) = 0;
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

namespace detail {

/// Refuses an option out of its range.
class ASTERISM_API RangeCheck final : public OptionVisitor {
 public:
  explicit RangeCheck(std::string_view of) : of_(of) {}

  using OptionVisitor::operator();
  void operator()(std::string_view name, double& value, const OptionRange& range) override {
    if (!(value >= range.least && value <= range.most)) refuse(name, value, range);
  }
  void operator()(std::string_view name, int& value, const OptionRange& range) override {
    if (!(value >= range.least && value <= range.most)) refuse(name, value, range);
  }
  void operator()(std::string_view, bool&) override {}
  void operator()(std::string_view, AnyPart&, std::string_view) override {}

 private:
  std::size_t choose(std::string_view, std::size_t value, std::initializer_list<std::string_view>) override {
    return value;
  }
  void enter(std::string_view name) override { path_.push_back(name); }
  void leave() override { path_.pop_back(); }
  [[noreturn]] void refuse(std::string_view name, double value, const OptionRange& range) const;

  std::string_view of_;
  std::vector<std::string_view> path_;
};

}  // namespace detail

/// For the constructor of what has options with a `visit_options`: throws std::invalid_argument for a number
/// out of its range, with the option's name, its value and the range: "OF: NAME must be in [0, 1], is 2".
/// Returns the options.
template <typename Options>
Options check_options(std::string_view of, Options options) {
  detail::RangeCheck check(of);
  visit_options(static_cast<OptionVisitor&>(check), options);
  return options;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
