#define ASTERISM_POSE_LANES 8
#include "pose_lanes.hpp"

namespace asterism::pose_kernels {

extern const Kernels kAvx512Kernels[2];
const Kernels kAvx512Kernels[2] = {kernels_of<2>(), kernels_of<3>()};

}  // namespace asterism::pose_kernels
