#pragma once

namespace asterism::bench {

/// Times the part models: the pieces of one step of a KCF (detect and train), the constellation of five for
/// which there is a bar, the Markov random field and, if installed, dlib's fHOG, OpenCV's dft and TrackerKCF.
/// Prints a line per figure. All take turns within one run, on one thread.
void parts_bench(bool quick);

}  // namespace asterism::bench
