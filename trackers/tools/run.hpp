#pragma once

#include <csignal>
#include <string>
#include <vector>

#include "image_source.hpp"

namespace asterism::tools {

/// The command line.
struct Options {
  std::string input, tracker = "dpt", out, save, sheet, systems, timeline, constellation;
  std::string config;                // the file that `tracker` was read from, if it was
  std::vector<std::string> boxes;    // of as many objects; none: that of the ground truth
  std::vector<std::string> compare;  // with the tracker, on the sheet
  bool show = false;
  int start = 1, frames = 0;  // frames: 0 for all
  FrameOptions source;
};

/// Set by a signal handler to the signal's number: `run` then stops after the frame at hand.
extern volatile std::sig_atomic_t g_stop_signal;

/// Tracks through the input and writes what the options ask for. Throws std::exception with the reason where
/// it cannot go on; what was written until then is kept and complete.
void run(const Options& options);

}  // namespace asterism::tools
