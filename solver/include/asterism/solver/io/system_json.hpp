#pragma once

#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/export.hpp>
#include <asterism/solver/terms/system.hpp>
#include <filesystem>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

/// @file
/// Systems of terms as JSON: docs/system-json.md is the format. Needs target asterism::system_json, which is
/// compiled: this header knows nothing of a JSON library.

namespace asterism {
inline namespace ASTERISM_ABI {

/// A system of terms and the other contents of its file.
struct StoredTerms {
  System system;              ///< nodes and terms
  Eigen::MatrixXd start;      ///< start of a solve, dim x nodes [px]; part of the problem
  std::string name;           ///< empty if it has none
  std::string origin = "{}";  ///< a JSON object of any form: where the system comes from
};

/// The systems in `text`: a JSON object, an array of objects, or an object a line (JSON lines); blank text
/// holds none. An object of version 1, a system of springs, becomes anchors, links and loads. Throws
/// std::runtime_error "SOURCE:LINE: system INDEX: terms[2]: FIELD ..." if an object is not as
/// docs/system-json.md says, or holds values that a solver would refuse.
ASTERISM_API std::vector<StoredTerms> parse_stored_terms(std::string_view text,
                                                         const std::string& source = "text");
/// The systems in a file; also throws if the file cannot be read.
ASTERISM_API std::vector<StoredTerms> read_stored_terms(const std::filesystem::path& path);

/// The JSON object of a system, version 2, on one line; every double of it comes back bit for bit. Throws
/// std::runtime_error for values that a solver would refuse (components without an anchor are allowed), for
/// a term with a function of one's own, and for an origin or a name that could not be read back.
ASTERISM_API std::string to_json(const StoredTerms& stored);
/// Appends a system to a stream, as one line of JSON lines. Throws as to_json, and then writes nothing. The
/// stream's state says whether it was written.
ASTERISM_API void write_stored_terms(std::ostream& out, const StoredTerms& stored);

}  // namespace ASTERISM_ABI
}  // namespace asterism
