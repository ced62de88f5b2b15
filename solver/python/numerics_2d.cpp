#include "numerics_impl.hpp"

namespace asterism::python {

ASTERISM_INSTANTIATE_NUMERICS(2);

std::vector<std::string_view> method_names() {
  std::vector<std::string_view> names;
  for (const Method<2>& method : methods<2>()) names.push_back(method.name);
  return names;
}

}  // namespace asterism::python
