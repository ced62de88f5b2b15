#pragma once

#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The range of a number, both ends included. NaN is never in range.
struct OptionRange {
  double least = -std::numeric_limits<double>::infinity();  ///< The least value in range.
  double most = std::numeric_limits<double>::infinity();    ///< The greatest value in range.
};

/// A reference to a member whose type is unknown here, but known to some visitors (such as a part model).
class MemberReference {
 public:
  /// Refers to this member.
  template <typename T>
  explicit MemberReference(T& member) : member_(&member), type_(&kType<T>) {}

  /// The member if it is a T, else nullptr.
  template <typename T>
  T* as() const {
    return type_ == &kType<T> ? static_cast<T*>(member_) : nullptr;
  }

 private:
  template <typename T>
  static inline char kType = 0;  // its address stands for T

  void* member_;
  const void* type_;
};

/// Visits the options of a solver, a part model or a tracker one by one, with their names, to set them or to
/// list them. For options of your own, write a function beside them, which is found by argument-dependent
/// lookup:
///
///     void visit_options(OptionVisitor& visit, MyOptions& options) {
///       visit("learning_rate", options.learning_rate, {0, 1});
///     }
///
/// The range of a number may be omitted. Choose ranges such that no value in them needs more than seconds and
/// megabytes. No name may be visited twice.
class OptionVisitor {
 public:
  virtual ~OptionVisitor() = default;

  /// A number or a switch.
  void operator()(std::string_view name, double& value) { (*this)(name, value, OptionRange()); }
  void operator()(std::string_view name, int& value) { (*this)(name, value, OptionRange()); }
  virtual void operator()(std::string_view name, double& value, const OptionRange& range) = 0;
  virtual void operator()(std::string_view name, int& value, const OptionRange& range) = 0;
  virtual void operator()(std::string_view name, bool& value) = 0;
  /// A seed: any number.
  virtual void operator()(std::string_view name, std::uint64_t& value) = 0;
  /// A member that is made from a name, such as a part (PartRegistry::make) or a solver (SolverDescription).
  /// `made`: the name that its present value was made from.
  template <typename T>
  requires std::is_class_v<T>
  void operator()(std::string_view name, T& member, std::string_view made) {
    made_by_name(name, MemberReference(member), made);
  }
  /// An enumeration whose values are 0, 1, ..., with the names of these values.
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
  /// For derived visitors only.
  OptionVisitor() = default;
  OptionVisitor(const OptionVisitor&) = default;
  OptionVisitor& operator=(const OptionVisitor&) = default;

 private:
  // By default, nothing changes.
  virtual void made_by_name(std::string_view, MemberReference, std::string_view) {}
  virtual std::size_t choose(std::string_view, std::size_t value, std::initializer_list<std::string_view>) {
    return value;
  }
  virtual void enter(std::string_view) {}
  virtual void leave() {}
};

namespace detail {

/// "must be in [0, 1], is 2"; whole numbers have all of their digits.
inline std::string out_of_range(const OptionRange& range, double value) {
  std::string text;
  const auto append = [&text](std::string_view before, double number) {
    const double size = std::abs(number);
    std::array<char, 32> buffer{};
    const auto form = size >= 1 && size < 1e15 ? std::chars_format::fixed : std::chars_format::general;
    char* const end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), number, form).ptr;
    text.append(before).append(buffer.data(), end);
  };
  append("must be in [", range.least);
  append(", ", range.most);
  append("], is ", value);
  return text;
}

/// Refuses an option that is out of range.
class RangeCheck final : public OptionVisitor {
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
  void operator()(std::string_view, std::uint64_t&) override {}

 private:
  void enter(std::string_view name) override { path_.push_back(name); }
  void leave() override { path_.pop_back(); }

  [[noreturn]] void refuse(std::string_view name, double value, const OptionRange& range) const {
    std::string message(of_);
    message += ": ";
    for (const std::string_view options : path_) message.append(options).append(1, '.');
    message.append(name).append(1, ' ').append(out_of_range(range, value));
    raise(std::invalid_argument(message));
  }

  std::string_view of_;
  std::vector<std::string_view> path_;
};

}  // namespace detail

/// For constructors that take options with a `visit_options`: returns the options, or throws
/// std::invalid_argument for a number out of range, with the option's name, its value and the range:
/// "OF: NAME must be in [0, 1], is 2".
template <typename Options>
Options check_options(std::string_view of, Options options) {
  detail::RangeCheck check(of);
  visit_options(static_cast<OptionVisitor&>(check), options);
  return options;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
