#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/edit_distance.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/energy/certifier_reference.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/solver.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <concepts>
#include <cstdint>
#include <functional>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// solve(convert(system), points) with x as its points, which become x where that is usable. Refuses what
/// convert.problem(system, x) names.
template <typename Convert, typename System, typename Solve>
Summary solve_converted(std::string_view name, const Convert& convert, const System& system,
                        typename System::Points& x, Solve&& solve) {
  if (const Message problem = convert.problem(system, x); !problem.empty()) return refused(name, problem);
  Summary summary;
  summary.solver = name;
  const auto work = [&] {
    const auto other = convert(system);
    using Other = std::remove_cv_t<decltype(other)>;
    typename Other::Points points = x.template cast<typename Other::Scalar>();
    summary = solve(other, points);
    if (summary.usable()) x = points.template cast<typename System::Scalar>();
  };
  attempt<std::bad_alloc>(work, [&](const std::bad_alloc& error) {
    summary.status = Status::OutOfMemory;
    summary.message = memory_message(error);
  });
  return summary;
}

}  // namespace detail

/// A solver of one type of systems, chosen at run time. It holds its workspace: reuse it, in one thread at a
/// time. A solve costs one virtual call more than a solve by the solver itself.
template <typename System>
class AnySolver {
 public:
  using Points = typename System::Points;

  /// Holds any type that is a Solver of this System, also one of the caller's own.
  template <typename S>
  requires(!std::same_as<S, AnySolver>) && Solver<S, System> explicit AnySolver(S solver)
      : model_(std::make_unique<ModelOf<S>>(std::move(solver))) {}
  /// The same, made in place by its default constructor.
  template <Solver<System> S>
  explicit AnySolver(std::in_place_type_t<S>) : model_(std::make_unique<ModelOf<S>>()) {}
  /// Holds a solver of another type of systems, which solves convert(system). Before that, convert.problem(
  /// system, x) is what is wrong with the input, if that is not empty.
  template <typename Other, typename Convert>
  AnySolver(AnySolver<Other> solver, Convert convert)
      : model_(std::make_unique<Converting<Other, Convert>>(std::move(solver), std::move(convert))) {}

  /// The name that Summary::solver has, such as "Newton, repaired LDL^T".
  std::string_view name() const { return model_->name(); }

  /// As with every solver: moves x (Dim x N), the start, to a stationary point of the energy.
  Summary solve(const System& system, Points& x) { return model_->solve(system, x); }

  /// The options that all solvers have.
  SolverOptions& options() { return model_->options(); }
  /// Serves the option gap if the options have no certifier; solvers of a registry have one.
  void set_certifier(CertifierSource source) { model_->certifier = std::move(source); }
  /// All of its options, by name.
  void visit_options(OptionVisitor& visit) { model_->visit_options(visit); }

 private:
  struct Model {
    virtual ~Model() = default;
    virtual std::string_view name() const = 0;
    virtual Summary solve(const System& system, Points& x) = 0;
    virtual SolverOptions& options() = 0;
    virtual void visit_options(OptionVisitor& visit) = 0;

    CertifierSource certifier;
  };

  template <typename S>
  struct ModelOf final : Model {
    ModelOf() = default;
    explicit ModelOf(S&& given) : solver(std::move(given)) {}
    std::string_view name() const override { return solver.name(); }
    Summary solve(const System& system, Points& x) override {
      SolverOptions& given = solver.options;
      if (!(given.gap > 0) || given.certifier || !this->certifier) [[likely]]
        return solver.solve(system, x);
      given.certifier = this->certifier();
      const Summary summary = solver.solve(system, x);
      given.certifier = {};
      return summary;
    }
    SolverOptions& options() override { return solver.options; }
    void visit_options(OptionVisitor& visit) override { see(visit, solver.options); }

    S solver;
  };

  template <typename Other, typename Convert>
  struct Converting final : Model {
    Converting(AnySolver<Other>&& s, Convert&& c) : solver(std::move(s)), convert(std::move(c)) {}
    std::string_view name() const override { return solver.name(); }
    Summary solve(const System& system, Points& x) override {
      return detail::solve_converted(name(), convert, system, x, [this](const Other& to, auto& points) {
        return solver.solve(to, points);
      });
    }
    SolverOptions& options() override { return solver.options(); }
    void visit_options(OptionVisitor& visit) override { solver.visit_options(visit); }

    AnySolver<Other> solver;
    Convert convert;
  };

  // Where the name is not hidden by the members'.
  template <typename Options>
  static void see(OptionVisitor& visit, Options& options) {
    using asterism::visit_options;
    visit_options(visit, options);
  }

  std::unique_ptr<Model> model_;
};

/// An option by its name, such as {"max_iterations", 50}.
struct NamedOption {
  std::string name;                                ///< As visit_options has it.
  std::variant<bool, std::int64_t, double> value;  ///< A switch, an integer or a number.

  /// A switch.
  NamedOption(std::string n, bool v) : name(std::move(n)), value(v) {}
  /// A number.
  NamedOption(std::string n, double v) : name(std::move(n)), value(v) {}
  /// An integer, which is also a number.
  template <std::integral T>
  NamedOption(std::string n, T v) : name(std::move(n)), value(static_cast<std::int64_t>(v)) {}
};

/// A solver by its name, with the options that differ from its defaults.
struct SolverDescription {
  std::string name;                  ///< As SolverRegistry has it.
  std::vector<NamedOption> options;  ///< that differ from the defaults
};

namespace detail {

/// The lower-case letters and the digits of a name, which is often written with others: "lbfgs" of "L-BFGS".
inline std::string letters_of(std::string_view name) {
  std::string letters;
  for (const char c : name) {
    if (c >= 'A' && c <= 'Z') letters += static_cast<char>(c - 'A' + 'a');
    if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9')) letters += c;
  }
  return letters;
}

/// What to use for a method of another library, whose name has these letters, where those of `known` are
/// there; empty for other names.
using MethodsElsewhere = std::string (*)(std::string_view letters, const std::vector<std::string>& known);

/// The message for a method that is not known.
inline std::string unknown_method(std::string_view name, const std::vector<std::string>& known,
                                  MethodsElsewhere elsewhere) {
  std::string message = "unknown method '" + std::string(name) + "'";
  const std::string letters = letters_of(name);
  const std::string answer = elsewhere != nullptr ? elsewhere(letters, known) : std::string();
  message.append(answer.empty() ? near_name(letters, known, letters_of) : ": use " + answer);
  return message.append(known_names(known));
}

/// Sets one option.
class OptionSetter final : public OptionVisitor {
 public:
  OptionSetter(std::string_view of, const NamedOption& option) : of_(of), option_(option) {}

  using OptionVisitor::operator();
  void operator()(std::string_view name, double& value, const OptionRange& range) override {
    if (!is_named(name)) return;
    double number = 0;
    if (const auto* real = std::get_if<double>(&option_.value)) {
      number = *real;
    } else if (const auto* integer = std::get_if<std::int64_t>(&option_.value)) {
      number = static_cast<double>(*integer);
    } else {
      refuse("must be a number");
    }
    if (!(number >= range.least && number <= range.most)) refuse(out_of_range(range, number));
    value = number;
  }
  void operator()(std::string_view name, int& value, const OptionRange& range) override {
    if (!is_named(name)) return;
    const auto* integer = std::get_if<std::int64_t>(&option_.value);
    if (integer == nullptr) refuse("must be an integer");
    const auto number = static_cast<double>(*integer);
    const OptionRange held{std::max(range.least, -2147483647.0), std::min(range.most, 2147483647.0)};
    if (!(number >= held.least && number <= held.most)) refuse(out_of_range(held, number));
    value = static_cast<int>(*integer);
  }
  void operator()(std::string_view name, bool& value) override {
    if (!is_named(name)) return;
    const auto* is_on = std::get_if<bool>(&option_.value);
    if (is_on == nullptr) refuse("must be true or false");
    value = *is_on;
  }
  void operator()(std::string_view name, std::uint64_t& value) override {
    if (!is_named(name)) return;
    const auto* integer = std::get_if<std::int64_t>(&option_.value);
    if (integer == nullptr || *integer < 0) refuse("must be an integer that is not negative");
    value = static_cast<std::uint64_t>(*integer);
  }

  /// Throws std::invalid_argument that names the nearest option, or all, if there was no option of this name.
  void check_found() const {
    if (found_) return;
    raise(std::invalid_argument(std::string(of_) + ": unknown option '" + option_.name + "'" +
                                name_hint(option_.name, names_)));
  }

 private:
  bool is_named(std::string_view name) {
    names_.emplace_back(name);
    found_ |= name == option_.name;
    return name == option_.name;
  }
  void made_by_name(std::string_view name, MemberReference, std::string_view) override {
    if (is_named(name)) refuse("cannot be set by a value");
  }
  std::size_t choose(std::string_view name, std::size_t value,
                     std::initializer_list<std::string_view>) override {
    if (is_named(name)) refuse("cannot be set by a value");
    return value;
  }
  [[noreturn]] void refuse(std::string_view what) const {
    raise(std::invalid_argument(std::string(of_) + ": option '" + option_.name + "' " + std::string(what)));
  }

  std::string_view of_;
  const NamedOption& option_;
  std::vector<std::string> names_;
  bool found_ = false;
};

}  // namespace detail

/// The solvers that a program knows for one type of systems, by name. For the option gap, each that is made
/// has a certifier of its own, if the registry has a source of them.
template <typename System>
class SolverRegistry {
 public:
  /// Adds a solver, made by its default constructor. Throws std::invalid_argument for a name that is taken.
  template <Solver<System> S>
  void add(std::string name) {
    add(std::move(name), [] { return AnySolver<System>(std::in_place_type<S>); });
  }
  /// Adds one by a function that makes it.
  void add(std::string name, std::function<AnySolver<System>()> make) {
    if (find(name) != entries_.end())
      detail::raise(std::invalid_argument("there is a solver '" + name + "' already"));
    entries_.push_back({std::move(name), std::move(make)});
  }

  /// A solver with these options. Throws std::invalid_argument that names the nearest known for an unknown
  /// solver or option, or what serves as another library's method, and says what is wrong with a value.
  AnySolver<System> make(std::string_view name, const std::vector<NamedOption>& options = {}) const {
    const auto at = find(name);
    if (at == entries_.end())
      detail::raise(std::invalid_argument(detail::unknown_method(name, names(), elsewhere_)));
    AnySolver<System> solver = at->make();
    if (certifier_) solver.set_certifier(certifier_);
    for (const NamedOption& option : options) {
      detail::OptionSetter set(name, option);
      solver.visit_options(set);
      set.check_found();
    }
    return solver;
  }

  /// The solver that a description names. Throws as above.
  AnySolver<System> make(const SolverDescription& solver) const { return make(solver.name, solver.options); }

  /// What errors say of other libraries' methods: method_elsewhere.
  void set_elsewhere(detail::MethodsElsewhere elsewhere) { elsewhere_ = elsewhere; }

  /// See kept_certifier.
  void set_certifier(CertifierSource source) { certifier_ = std::move(source); }

  /// In the order in which they were added.
  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const Entry& entry : entries_) names.push_back(entry.name);
    return names;
  }

 private:
  struct Entry {
    std::string name;
    std::function<AnySolver<System>()> make;
  };

  auto find(std::string_view name) const {
    return std::find_if(entries_.begin(), entries_.end(),
                        [name](const Entry& entry) { return entry.name == name; });
  }

  std::vector<Entry> entries_;
  CertifierSource certifier_;
  detail::MethodsElsewhere elsewhere_ = nullptr;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
