#include "isolated.hpp"

#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <exception>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>

namespace asterism::bench {
namespace {

constexpr int kTimeout = 60000;  // [ms]

/// Both transfer all `size` bytes; false if the other end is closed or sends nothing for `timeout` [ms].
bool send_all(int socket, const void* data, std::size_t size) {
  const char* at = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t count = send(socket, at, size, MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    at += count;
    size -= static_cast<std::size_t>(count);
  }
  return true;
}
bool receive_all(int socket, void* data, std::size_t size, int timeout) {
  char* at = static_cast<char*>(data);
  while (size > 0) {
    pollfd ready{socket, POLLIN, 0};
    const int polled = poll(&ready, 1, timeout);
    if (polled < 0 && errno == EINTR) continue;
    if (polled <= 0) return false;
    const ssize_t count = recv(socket, at, size, 0);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    at += count;
    size -= static_cast<std::size_t>(count);
  }
  return true;
}

bool send_text(int socket, const std::string& text) {
  const std::uint64_t size = text.size();
  return send_all(socket, &size, sizeof size) && send_all(socket, text.data(), text.size());
}
bool receive_text(int socket, std::string& text) {
  std::uint64_t size = 0;
  if (!receive_all(socket, &size, sizeof size, kTimeout)) return false;
  text.resize(size);
  return receive_all(socket, text.data(), text.size(), kTimeout);
}

/// An answer: an error's message, empty for none, then the region's text, empty for none, and the confidence.
bool send_report(int socket, const std::string& error, const Report& report) {
  return send_text(socket, error) && send_text(socket, report.region ? to_string(*report.region) : "") &&
         send_all(socket, &report.confidence, sizeof report.confidence);
}

/// The child's work: the start, then an answer for every image until the parent closes its end.
void serve(int socket, const Start& start, const Image& image, const Region& region) {
  Step step;
  const auto answer = [&](auto&& call) {
    Report report;
    std::string error;
    try {
      report = call();
    } catch (const std::exception& e) {
      error = std::string(e.what()).empty() ? "an error without message" : e.what();
    }
    return send_report(socket, error, report);
  };
  bool served = answer([&] {
    step = start(image, region);
    return Report{};
  });
  std::array<int, 3> header{};  // rows, columns, type
  while (served && receive_all(socket, header.data(), sizeof header, -1)) {
    cv::Mat pixels(header[0], header[1], header[2]);
    std::string file;
    served = receive_all(socket, pixels.data, pixels.total() * pixels.elemSize(), kTimeout) &&
             receive_text(socket, file) && answer([&] { return step(Image(pixels, file)); });
  }
}

class Child {
 public:
  Child(const Start& start, const Image& image, const Region& region) {
    // One at a time: a child that inherited the end of another child's socket would keep it open after that
    // one's death, which would go unnoticed.
    static std::mutex forking;
    const std::lock_guard lock(forking);
    std::array<int, 2> ends{};
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) fail("socketpair");
    pid_ = fork();
    if (pid_ == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      close(ends[0]);
      serve(ends[1], start, image, region);
      _exit(0);
    }
    close(ends[1]);
    socket_ = ends[0];
    if (pid_ < 0) {
      close(socket_);
      fail("fork");
    }
  }
  ~Child() {
    close(socket_);
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      wait();
    }
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  Report answer() {
    Report report;
    std::string error, region;
    if (!receive_text(socket_, error) || !receive_text(socket_, region) ||
        !receive_all(socket_, &report.confidence, sizeof report.confidence, kTimeout))
      throw std::runtime_error(epitaph());
    if (!error.empty()) throw std::runtime_error(error);
    report.region = tools::parse_region(region);
    return report;
  }

  Report step(const Image& image) {
    const cv::Mat pixels = image.pixels.isContinuous() ? image.pixels : image.pixels.clone();
    const std::array<int, 3> header = {pixels.rows, pixels.cols, pixels.type()};
    if (!send_all(socket_, header.data(), sizeof header) ||
        !send_all(socket_, pixels.data, pixels.total() * pixels.elemSize()) ||
        !send_text(socket_, image.file.string()))
      throw std::runtime_error(epitaph());
    return answer();
  }

 private:
  [[noreturn]] static void fail(const char* call) {
    throw std::runtime_error(std::string(call) + ": " + std::strerror(errno));
  }

  int wait() {
    int status = 0;
    while (waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    return status;
  }

  // Why the child does not answer.
  std::string epitaph() {
    if (pid_ < 0) return "the tracker has ended";
    int status = 0;
    pid_t ended = 0;
    for (int attempt = 0; attempt < 50 && ended == 0;
         ++attempt) {  // its socket closes before it can be waited for
      ended = waitpid(pid_, &status, WNOHANG);
      if (ended == 0) usleep(2000);
    }
    if (ended == 0) return "the tracker did not answer within " + std::to_string(kTimeout / 1000) + " s";
    pid_ = -1;
    return WIFSIGNALED(status) ? "the tracker crashed: " + std::string(strsignal(WTERMSIG(status)))
                               : "the tracker ended with code " + std::to_string(WEXITSTATUS(status));
  }

  pid_t pid_ = -1;
  int socket_ = -1;
};

}  // namespace

Start isolated(const Start& start) {
  return [start](const Image& image, const Region& region) -> Step {
    auto child = std::make_shared<Child>(start, image, region);
    child->answer();
    return [child](const Image& next) { return child->step(next); };
  };
}

}  // namespace asterism::bench
