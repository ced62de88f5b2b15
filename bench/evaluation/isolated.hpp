#pragma once

#include "peers.hpp"

namespace asterism::bench {

/// The same tracker with a process for each start, for trackers that may crash: a crash, or no answer within
/// a minute, becomes a std::runtime_error with the reason. Images go through a socket, which takes some
/// 0.3 ms per megabyte.
Start isolated(const Start& start);

}  // namespace asterism::bench
