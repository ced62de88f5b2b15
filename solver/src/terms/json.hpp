#pragma once

#include <asterism/solver/detail/export.hpp>
#include <asterism/solver/io/system_json.hpp>
#include <nlohmann/json_fwd.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The system that a JSON object holds. Throws std::runtime_error that names the field.
ASTERISM_API StoredTerms stored_terms_from_json(const nlohmann::json& object);

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
