#include "process.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fstream>
#include <stdexcept>
#include <thread>

#ifdef ASTERISM_BENCH_MPI
#include <mpi.h>
#endif

namespace asterism::bench {

namespace {

volatile std::sig_atomic_t g_stop_signal = 0;

}  // namespace

#ifdef ASTERISM_BENCH_MPI

Processes::Processes(int& argc, char**& argv) {
  // Only the main thread calls MPI.
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  MPI_Comm_rank(MPI_COMM_WORLD, &shard_.index);
  MPI_Comm_size(MPI_COMM_WORLD, &shard_.count);
}

Processes::~Processes() { MPI_Finalize(); }

void Processes::abort() const {
  if (shard_.count > 1) MPI_Abort(MPI_COMM_WORLD, 1);
}

std::function<void()> Processes::barrier() const {
  return [] { MPI_Barrier(MPI_COMM_WORLD); };
}

#else

Processes::Processes(int&, char**&) {}
Processes::~Processes() = default;
void Processes::abort() const {}
std::function<void()> Processes::barrier() const { return {}; }

#endif

Json parse_json(std::string_view text) try {
  constexpr int kDeepest = 64;
  // An ordered object compares each new key with all before it: 100,000 would take a minute.
  using Sorted = nlohmann::json;
  const auto check = [](int depth, Sorted::parse_event_t, Sorted&) {
    if (depth > kDeepest) throw std::runtime_error("values are nested deeper than 64 levels");
    return true;
  };
  return Json(Sorted::parse(text, check));
} catch (const nlohmann::json::exception& error) {
  throw std::runtime_error(error.what());
}

FolderLock::FolderLock(const std::filesystem::path& folder, std::chrono::seconds patience) {
  file_ = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file_ < 0) throw std::runtime_error(folder.string() + ": " + std::strerror(errno));
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (flock(file_, LOCK_EX | LOCK_NB) != 0) {
    const int error = errno;
    if (error == EINTR) continue;
    if (error == EWOULDBLOCK && std::chrono::steady_clock::now() < deadline) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      continue;
    }
    close(file_);
    throw std::runtime_error(
        folder.string() + ": " +
        (error == EWOULDBLOCK ? "another process is at work there" : std::strerror(error)));
  }
}

// Closing the file releases its lock.
FolderLock::~FolderLock() { close(file_); }

std::string digest(std::string_view text) {
  std::uint64_t hash = 14695981039346656037u;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211u;
  std::array<char, 17> result{};
  std::snprintf(result.data(), result.size(), "%016llx", static_cast<unsigned long long>(hash));
  return result.data();
}

void stop_on_signals() {
  struct sigaction action = {};
  action.sa_handler = [](int signal) { g_stop_signal = signal; };
  action.sa_flags =
      static_cast<int>(SA_RESETHAND | SA_RESTART);  // the second Ctrl-C ends the process at once
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

int stop_signal() { return g_stop_signal; }

std::string utc_now() {
  const std::time_t time = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&time, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text.data();
}

Json process_machine() {
  Json result;
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    if (line.starts_with("model name")) {
      result["cpu"] = line.substr(line.find(':') + 2);
      break;
    }
  }
  result["cores"] = std::thread::hardware_concurrency();
#ifdef __clang__
  result["compiler"] = "clang " __clang_version__;
#else
  result["compiler"] = "gcc " __VERSION__;
#endif
  result["build"] = ASTERISM_BENCH_BUILD;
  return result;
}

}  // namespace asterism::bench
