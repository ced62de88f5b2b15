#pragma once

#include <asterism/solver/base/config.hpp>
#include <string>

namespace asterism {
inline namespace ASTERISM_ABI {

/// An option that is a text, such as the name of a file.
struct OptionText {
  std::string text;  ///< empty: not given
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
