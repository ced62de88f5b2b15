#pragma once

#include "peers.hpp"

namespace asterism::bench {

/// The same tracker, each start in a process of its own, for those that may crash: that, or no answer within
/// a minute, is then a std::runtime_error with the reason. Images go through a socket, some 0.3 ms a
/// megabyte.
Start isolated(const Start& start);

}  // namespace asterism::bench
