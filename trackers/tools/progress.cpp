#include "progress.hpp"

#include <unistd.h>

#include <asterism/solver/base/counted.hpp>
#include <cstdio>

namespace asterism::tools {

Progress::Progress(int total) : total_(total), terminal_(isatty(STDERR_FILENO) != 0) {}

Progress::~Progress() {
  if (terminal_ && shown_) std::fputs("\r\033[K", stderr);
}

void Progress::report(int done) {
  const Clock::time_point now = Clock::now();
  if (now - last_ < (terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(5000))) return;
  last_ = now;
  shown_ = true;
  const double fps = done / std::chrono::duration<double>(now - start_).count();
  if (terminal_) std::fputs("\r\033[K", stderr);
  if (total_ > 0) {
    std::fprintf(stderr, "%d / %d frames, %.1f fps, %.0f s left", done, total_, fps, (total_ - done) / fps);
  } else {
    std::fprintf(stderr, "%s, %.1f fps", asterism::detail::counted(done, "frame").c_str(), fps);
  }
  if (!terminal_) std::fputc('\n', stderr);
  std::fflush(stderr);
}

}  // namespace asterism::tools
