#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/terms/system.hpp>
#include <concepts>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <ostream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

/// @file
/// Systems as JSON, so that a hard case can be kept and sent: docs/system-json.md is the format. A file holds
/// one system, an array of them, or one a line (JSON lines). Version 1 of the format holds systems of
/// springs, version 2 those of terms. Needs target asterism::json, which is compiled: this header knows
/// nothing of a JSON library.

namespace asterism {
inline namespace ASTERISM_ABI {

/// A system that version 1 of the format holds: of double, any dimension and bounds on the number of nodes;
/// springs (Springs) or springs on anisotropic anchors.
template <typename S>
concept StorableSystem = std::same_as<typename S::Scalar, double> &&
    std::same_as<typename S::Model, Model<Hooke, Quadratic, S::Model::kAnchorShape>>;

/// A spring system and the other contents of its file.
template <StorableSystem System = SpringSystem<double, 2>>
struct StoredSystem {
  System system;                  ///< the springs themselves
  typename System::Points start;  ///< start of a solve, Dim x N [px]; part of the problem
  std::string name;               ///< empty if it has none
  std::string origin = "{}";      ///< a JSON object of any form: where the system comes from
};

/// A system of the plane or of space, whichever its file holds.
using AnyStoredSystem =
    std::variant<StoredSystem<SpringSystem<double, 2>>, StoredSystem<SpringSystem<double, 3>>>;

/// A system of terms and the other contents of its file.
struct StoredTerms {
  System system;              ///< nodes and terms
  Eigen::MatrixXd start;      ///< start of a solve, dim x nodes [px]; part of the problem
  std::string name;           ///< empty if it has none
  std::string origin = "{}";  ///< a JSON object of any form: where the system comes from
};

namespace detail {

/// The arrays of a system of springs, as version 1 has them.
struct StoredSprings {
  Eigen::MatrixXd anchors, anchor_shape;  ///< dim x nodes; dim x (dim nodes) or empty
  Eigen::VectorXd anchor_stiffness;
  std::vector<Link> links;
  Eigen::VectorXd rest_length, link_stiffness;
  Eigen::MatrixXd rest_offset, loads;  ///< a column for each link, or node, or empty
  std::vector<int> fixed;
  Eigen::MatrixXd start;
  std::string name, origin;
};

constexpr int kAnyDimension = -1;

/// Receives the systems of a text, one after the other.
struct StoredVisitor {
  int dim = 0;                ///< of springs: the only one that is taken; 0: 2 and 3; or kAnyDimension
  bool takes_shapes = false;  ///< whether springs' anchors may be anisotropic
  std::function<void(StoredSprings&&)> springs;  ///< of version 1; may throw std::runtime_error
  std::function<void(StoredTerms&&)> terms;      ///< of version 2, which is refused without it
};

/// Throws std::runtime_error, see parse_systems.
ASTERISM_API void for_each_stored(std::string_view text, const std::string& source,
                                  const StoredVisitor& visitor);
/// The text of a file. Throws std::runtime_error.
ASTERISM_API std::string read_text(const std::filesystem::path& path);
/// An object on one line. Throws std::runtime_error, see to_json.
ASTERISM_API std::string to_json(const StoredSprings& springs);

/// Refuses what a solver would refuse: no nodes, shapes that are none, ...
template <StorableSystem System>
void require_valid(const System& system, const typename System::Points& start) {
  if (const Defect defect = validate_values(system, start))
    raise(std::runtime_error(std::string(std::string_view(Message(defect)))));
}

template <StorableSystem System>
StoredSystem<System> from_stored(StoredSprings&& stored) {
  const auto nodes = static_cast<int>(stored.anchors.cols());
  StoredSystem<System> result{.system = System(System::TopologyType::from_links(nodes, stored.links)),
                              .start = {},
                              .name = std::move(stored.name),
                              .origin = std::move(stored.origin)};
  System& system = result.system;
  if (const Defect& defect = system.defect())  // more nodes than the type has
    raise(std::runtime_error(std::string(std::string_view(Message(defect)))));
  system.anchors = stored.anchors;
  system.anchor_stiffness = stored.anchor_stiffness;
  system.rest_length = stored.rest_length;
  system.link_stiffness = stored.link_stiffness;
  if (stored.rest_offset.cols() > 0) system.rest_offset = stored.rest_offset;
  if (stored.loads.cols() > 0) system.loads = stored.loads;
  if constexpr (System::kAnisotropic) {
    if (stored.anchor_shape.size() > 0) {
      system.anchor_shape = stored.anchor_shape;
    } else {
      for (int i = 0; i < nodes; ++i)
        system.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i).setIdentity();
    }
  }
  for (const int i : stored.fixed) system.fix(i);
  result.start = stored.start;
  require_valid(system, result.start);
  return result;
}

inline AnyStoredSystem any_from_stored(StoredSprings&& stored) {
  if (stored.anchors.rows() == 2) return from_stored<SpringSystem<double, 2>>(std::move(stored));
  return from_stored<SpringSystem<double, 3>>(std::move(stored));
}

template <StorableSystem System, typename Take>
StoredVisitor visitor_of(Take&& take) {
  return {System::kDim,
          System::kAnisotropic,
          [&take](StoredSprings&& stored) { take(from_stored<System>(std::move(stored))); },
          {}};
}

}  // namespace detail

/// The systems in `text`: a JSON object, an array of objects, or an object a line (JSON lines); blank text
/// holds none. Throws std::runtime_error "SOURCE:LINE: system INDEX: FIELD ...": the line for JSON lines and
/// for what cannot be read as a value, the index, from 0, for systems in an array. The field is named if an
/// object is not as docs/system-json.md says, has another version or dimension or more nodes than `System`,
/// or has anisotropic anchors and `System` does not (a System with anisotropic anchors also reads isotropic
/// ones).
template <StorableSystem System>
std::vector<StoredSystem<System>> parse_systems(std::string_view text, const std::string& source = "text") {
  std::vector<StoredSystem<System>> systems;
  const auto take = [&](StoredSystem<System>&& system) { systems.push_back(std::move(system)); };
  detail::for_each_stored(text, source, detail::visitor_of<System>(take));
  return systems;
}
/// The same for systems of the plane and of space, also in one text.
inline std::vector<AnyStoredSystem> parse_systems(std::string_view text, const std::string& source = "text") {
  std::vector<AnyStoredSystem> systems;
  detail::StoredVisitor visitor;
  visitor.springs = [&](detail::StoredSprings&& stored) {
    systems.push_back(detail::any_from_stored(std::move(stored)));
  };
  detail::for_each_stored(text, source, visitor);
  return systems;
}
/// The same for systems of both versions: one of springs becomes anchors, links and loads.
ASTERISM_API std::vector<StoredTerms> parse_stored_terms(std::string_view text,
                                                         const std::string& source = "text");

/// The systems in a file; also throws if the file cannot be read.
template <StorableSystem System>
std::vector<StoredSystem<System>> read_systems(const std::filesystem::path& path) {
  return parse_systems<System>(detail::read_text(path), path.string());
}
inline std::vector<AnyStoredSystem> read_systems(const std::filesystem::path& path) {
  return parse_systems(detail::read_text(path), path.string());
}
ASTERISM_API std::vector<StoredTerms> read_stored_terms(const std::filesystem::path& path);

/// The JSON object of a system, on one line; every double of it comes back bit for bit. Throws
/// std::runtime_error if a solver would refuse the values (NaN, infinity, a negative stiffness, ...;
/// components without an anchor are allowed), for a term with a function of the user's, for text that is not
/// UTF-8, and for an origin that is no JSON object, or is nested more than 98 levels deep, which could not be
/// read back.
template <StorableSystem System>
std::string to_json(const StoredSystem<System>& stored) {
  const System& system = stored.system;
  try {
    detail::require_valid(system, stored.start);
  } catch (const std::runtime_error& error) {
    detail::raise(std::runtime_error(std::string("the system cannot be written: ") + error.what()));
  }
  detail::StoredSprings springs;
  springs.anchors = system.anchors;
  if constexpr (System::kAnisotropic) springs.anchor_shape = system.anchor_shape;
  springs.anchor_stiffness = system.anchor_stiffness;
  springs.links.assign(system.links().begin(), system.links().end());
  springs.rest_length = system.rest_length;
  springs.link_stiffness = system.link_stiffness;
  if (system.has_offsets()) springs.rest_offset = system.rest_offset;
  if (system.has_loads()) springs.loads = system.loads;
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) springs.fixed.push_back(i);
  }
  springs.start = stored.start;
  springs.name = stored.name;
  springs.origin = stored.origin;
  return detail::to_json(springs);
}
ASTERISM_API std::string to_json(const StoredTerms& stored);

/// Appends a system to a stream, as one line of JSON lines. Throws as to_json, and then writes nothing. The
/// stream's state says whether it was written.
template <StorableSystem System>
void write_system(std::ostream& out, const StoredSystem<System>& stored) {
  out << to_json(stored) + '\n';
}
template <StorableSystem System>
void write_system(std::ostream& out, const System& system, const typename System::Points& start,
                  std::string name = {}, std::string origin = "{}") {
  write_system(out, StoredSystem<System>{system, start, std::move(name), std::move(origin)});
}
ASTERISM_API void write_stored_terms(std::ostream& out, const StoredTerms& stored);

}  // namespace ASTERISM_ABI
}  // namespace asterism
