#pragma once

#include <csignal>
#include <string>
#include <vector>

#include "image_source.hpp"

namespace asterism::tools {

/// The command line.
struct Options {
  std::string input, tracker = "dpt_plus", out, save, sheet, systems, timeline, constellation;
  std::string config;                // the file that `tracker` was read from, if any
  std::vector<std::string> boxes;    // one per object; none: from the ground truth
  std::vector<std::string> compare;  // other trackers on the sheet
  bool show = false, smooth = false;
  int start = 1, frames = 0;  // frames: 0 for all
  bool wait = false;          // from `start` on, for the first frame that shows a scene
  FrameOptions source;
};

/// Set by a signal handler to the signal's number: `run` then stops after the current frame.
extern volatile std::sig_atomic_t g_stop_signal;

/// Tracks through the input and writes the requested outputs. Throws std::exception with the reason if it
/// cannot continue; what has been written by then is kept and complete.
void run(const Options& options);

}  // namespace asterism::tools
