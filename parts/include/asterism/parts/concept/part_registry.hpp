#pragma once

#include <asterism/parts/concept/any_part.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {
/// Throws std::invalid_argument, with a message that begins with `of`, for JSON that is nested so deep that
/// visiting it might overflow the stack.
ASTERISM_API void check_nesting(const std::string& of, std::string_view json);
}  // namespace detail

/// Part models by name, with options from JSON: the library's own, those that a program adds, and those of
/// shared libraries (part_plugin.hpp).
class ASTERISM_API PartRegistry {
 public:
  /// Has the library's models: "color_histogram", "flow", "kcf", "keypoints", "mosse",
  /// "spatial_reliability", "strcf", "superpixels", "template"; not "flow" and "keypoints" if they were not
  /// built.
  PartRegistry();

  /// Adds a model, which is made of its options, under a name of letters, digits, '_' and '-'. Throws
  /// std::invalid_argument for any other name and for one that is taken.
  template <PartModel Model, typename Options>
  requires std::constructible_from<Model, const Options&>
  void add(const std::string& name) {
    add(name, [](OptionVisitor& visit) {
      Options options;
      visit_options(visit, options);
      return [options]() -> AnyPart { return Model(options); };
    });
  }

  /// Loads a shared library of part models and adds each, as "LIBRARY:MODEL" with the path as it is given;
  /// returns these names. A library stays loaded until the process ends; loading it again changes nothing.
  /// Throws std::runtime_error, without having added any, for a file that cannot be loaded, is no library of
  /// part models, was built for another version of this one, of Eigen or of OpenCV, or throws.
  ///
  /// An exception of such a model becomes std::invalid_argument if it was one, else std::runtime_error,
  /// with the model's name; so does evidence or a similarity that is not finite.
  std::vector<std::string> load(const std::string& library);

  /// A model from its name, which may be followed by a JSON object of options: `mosse`,
  /// `kcf{"lambda": 1e-3}`. The library of a name LIBRARY:MODEL is loaded. Throws std::invalid_argument that
  /// names the nearest known for an unknown model or option, and says what is wrong with a value.
  AnyPart make(std::string_view model);

  /// Sets options that have a `visit_options` to the values in a JSON object. A part model is given as `make`
  /// takes it, or as an object with its name as "model" and its options beside it. Throws
  /// std::invalid_argument as `make` does, with messages that begin with `of`.
  template <typename Options>
  void read(const std::string& of, std::string_view json, Options& options) {
    read_json(of, json, [&](OptionVisitor& visit) { visit_options(visit, options); });
  }
  /// Such options as a JSON object that `read` takes. Part models of the library are listed with all of their
  /// options, others by their name only.
  template <typename Options>
  static std::string list(Options options) {
    return list_json([&](OptionVisitor& visit) { visit_options(visit, options); });
  }

  /// The names of all models, sorted; except `siamese`, which needs a user's networks.
  std::vector<std::string> names() const;
  /// All options of a model and their defaults as a JSON object. Throws as `make`.
  std::string defaults(std::string_view name);

 private:
  // Visits the options, and returns what makes a part of the values that they have then.
  using Factory = std::function<std::function<AnyPart()>(OptionVisitor&)>;
  using Visit = std::function<void(OptionVisitor&)>;
  using Factories = std::map<std::string, Factory, std::less<>>;

  explicit PartRegistry(Factories factories) : factories_(std::move(factories)) {}
  void add(const std::string& name, Factory&& factory);
  void read_json(const std::string& of, std::string_view json, const Visit& options);
  static std::string list_json(const Visit& options);
  const Factory& find(std::string_view name);

  Factories factories_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
