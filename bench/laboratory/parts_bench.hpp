#pragma once

namespace asterism::bench {

/// Times the part models: what one step of a KCF (detect and train) is made of, the constellation of five
/// that the bar is for, the Markov random field, and beside them dlib's fHOG, OpenCV's dft and TrackerKCF
/// where they are installed; a line a figure. All take turns within one run, on one thread.
void parts_bench(bool quick);

}  // namespace asterism::bench
