#pragma once

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <string>

#ifdef __linux__
#include <linux/perf_event.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

namespace asterism::bench {

/// The processor's counts of cycles and instructions of the calling thread in user mode, between start() and
/// stop(), by Linux's perf_event_open. Virtual machines and containers often have or allow none; then
/// available() is false and problem() says why.
class HardwareCounters {
 public:
#ifdef __linux__
  HardwareCounters() {
    cycles_ = open(PERF_COUNT_HW_CPU_CYCLES, -1);
    if (cycles_ >= 0) instructions_ = open(PERF_COUNT_HW_INSTRUCTIONS, cycles_);
    if (!available()) problem_ = std::string("perf_event_open: ") + std::strerror(errno);
  }
  ~HardwareCounters() {
    if (instructions_ >= 0) close(instructions_);
    if (cycles_ >= 0) close(cycles_);
  }

  bool available() const { return instructions_ >= 0; }

  void start() {
    if (!available()) return;
    ioctl(cycles_, PERF_EVENT_IOC_RESET, PERF_IOC_FLAG_GROUP);
    ioctl(cycles_, PERF_EVENT_IOC_ENABLE, PERF_IOC_FLAG_GROUP);
  }

  /// False if they did not count.
  bool stop() {
    if (!available()) return false;
    ioctl(cycles_, PERF_EVENT_IOC_DISABLE, PERF_IOC_FLAG_GROUP);
    return read(cycles_, &counts_, sizeof counts_) == static_cast<ssize_t>(sizeof counts_) &&
           counts_.running > 0;
  }

  double cycles() const { return scaled(counts_.cycles); }
  double instructions() const { return scaled(counts_.instructions); }
#else
  HardwareCounters() : problem_("perf_event_open: not Linux") {}
  bool available() const { return false; }
  void start() {}
  bool stop() { return false; }
  double cycles() const { return 0; }
  double instructions() const { return 0; }
#endif
  HardwareCounters(const HardwareCounters&) = delete;
  HardwareCounters& operator=(const HardwareCounters&) = delete;

  const std::string& problem() const { return problem_; }

 private:
  std::string problem_;
#ifdef __linux__
  // The layout that read() fills in for a group of counters with times.
  struct Counts {
    std::uint64_t size;     // of the group
    std::uint64_t enabled;  // [ns]
    std::uint64_t running;  // [ns], less than `enabled` if counters are shared with other programs
    std::uint64_t cycles;
    std::uint64_t instructions;
  };

  // Opens a counter for the calling thread, on any processor.
  static int open(std::uint64_t event, int group) {
    perf_event_attr attributes{};
    attributes.size = sizeof attributes;
    attributes.type = PERF_TYPE_HARDWARE;
    attributes.config = event;
    attributes.disabled = group < 0;  // members start and stop with their group's leader
    attributes.exclude_kernel = 1;
    attributes.exclude_hv = 1;
    attributes.read_format =
        PERF_FORMAT_GROUP | PERF_FORMAT_TOTAL_TIME_ENABLED | PERF_FORMAT_TOTAL_TIME_RUNNING;
    return static_cast<int>(syscall(SYS_perf_event_open, &attributes, 0, -1, group, 0UL));
  }

  double scaled(std::uint64_t count) const {
    return static_cast<double>(count) * static_cast<double>(counts_.enabled) /
           static_cast<double>(counts_.running);
  }

  int cycles_ = -1;
  int instructions_ = -1;
  Counts counts_{};
#endif
};

}  // namespace asterism::bench
