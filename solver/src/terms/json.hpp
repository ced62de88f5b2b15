#pragma once

#include <asterism/solver/detail/export.hpp>
#include <asterism/solver/io/system_json.hpp>
#include <nlohmann/json_fwd.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Whether a JSON object is to be read by stored_terms_from_json: it has a version, which is not 1.
ASTERISM_API bool holds_terms(const nlohmann::json& object);
/// The system that a JSON object of any version holds. Throws std::runtime_error that names the field.
ASTERISM_API StoredTerms stored_terms_from_json(const nlohmann::json& object);

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
