#pragma once

namespace asterism::bench {

// Tables of the solvers that Auto chooses from: CPU time against size, linking and strength of the anchors.
void dense_crossovers();
/// Up to 1e5 nodes, or 1e4 with `quick`.
void sparse_crossovers(bool quick);

}  // namespace asterism::bench
