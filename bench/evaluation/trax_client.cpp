#include "trax_client.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <thread>
#include <utility>

extern char** environ;

namespace asterism::tools {
namespace {

using Clock = std::chrono::steady_clock;
using Type = TraxMessage::Type;

// How long a tracker that was told to quit, or has closed its streams, may take to end.
constexpr std::chrono::seconds kPatience(3);

Clock::time_point after(double seconds) {
  constexpr double kMost = 1e9;  // which the clock can hold
  return Clock::now() +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(std::min(seconds, kMost)));
}

[[noreturn]] void throw_errno(const std::string& what) {
  throw TraxError(what + ": " + std::strerror(errno));
}

// A file descriptor that is closed at the end.
class Descriptor {
 public:
  explicit Descriptor(int value = -1) : value_(value) {}
  ~Descriptor() { reset(); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  int get() const { return value_; }
  void reset(int value = -1) {
    if (value_ >= 0) close(value_);
    value_ = value;
  }

 private:
  int value_;
};

// Waits for any of `events`; 0 if none comes before the deadline.
short wait_for(int descriptor, short events, Clock::time_point deadline) {
  while (true) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count();
    constexpr long long kLongest = 60'000;  // the deadline may be years away
    pollfd wait = {descriptor, events, 0};
    const int count = poll(&wait, 1, static_cast<int>(std::clamp<long long>(left, 0, kLongest)));
    if (count > 0) return wait.revents;
    if (count < 0 && errno != EINTR) throw_errno("poll");
    if (count == 0 && left <= 0) return 0;
  }
}

// A port of this machine that waits for one tracker.
class Listener {
 public:
  Listener() : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* any = reinterpret_cast<sockaddr*>(&address);
    if (socket_.get() < 0 || bind(socket_.get(), any, size) != 0 || listen(socket_.get(), 1) != 0 ||
        getsockname(socket_.get(), any, &size) != 0) {
      throw_errno("cannot listen for the tracker");
    }
    port_ = ntohs(address.sin_port);
  }

  int port() const { return port_; }

  // The connection of a tracker, or -1 if none connects before the deadline.
  int accept_until(Clock::time_point deadline) {
    if (wait_for(socket_.get(), POLLIN, deadline) == 0) return -1;
    const int descriptor = accept4(socket_.get(), nullptr, nullptr, SOCK_CLOEXEC);
    if (descriptor < 0) throw_errno("cannot accept the tracker's connection");
    const int on = 1;
    setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return descriptor;
  }

 private:
  Descriptor socket_;
  int port_ = 0;
};

std::vector<std::string> environment(std::optional<int> port) {
  std::vector<std::string> variables = {"TRAX=1"};  // as the VOT toolkit sets it
  if (port) variables.push_back("TRAX_SOCKET=" + std::to_string(*port));
  for (char** variable = environ; *variable != nullptr; ++variable) {
    const std::string_view name = std::string_view(*variable).substr(0, std::strcspn(*variable, "="));
    if (name != "TRAX" && name != "TRAX_SOCKET" && name != "TRAX_IN" && name != "TRAX_OUT") {
      variables.emplace_back(*variable);
    }
  }
  return variables;
}

// A shell command as a process; it and all that it has started end with this object.
class Child {
 public:
  Child(std::string command, int in, int out, int err, std::optional<int> port) {
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
    posix_spawn_file_actions_adddup2(&actions, in, STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, out, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, err, STDERR_FILENO);
    // Its own process group, which can be ended as a whole, and default signals, as programs expect them.
    sigset_t none, defaults;
    sigemptyset(&none);
    sigemptyset(&defaults);
    sigaddset(&defaults, SIGPIPE);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    posix_spawnattr_setflags(&attributes,
                             POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    std::string shell = "/bin/sh", option = "-c";
    const std::array<char*, 4> arguments = {shell.data(), option.data(), command.data(), nullptr};
    std::vector<std::string> variables = environment(port);
    std::vector<char*> pointers;
    pointers.reserve(variables.size() + 1);
    for (std::string& variable : variables) pointers.push_back(variable.data());
    pointers.push_back(nullptr);
    const int error =
        posix_spawn(&id_, shell.c_str(), &actions, &attributes, arguments.data(), pointers.data());
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    if (error != 0) throw TraxError(std::string("cannot be started: ") + std::strerror(error));
  }

  ~Child() {
    if (running_) reap();
  }

  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  // Whether the process has ended by the deadline.
  bool wait_until(Clock::time_point deadline) {
    std::chrono::milliseconds pause(1);
    while (running_) {
      siginfo_t info = {};
      const bool known = waitid(P_PID, static_cast<id_t>(id_), &info, WEXITED | WNOHANG | WNOWAIT) == 0;
      if (!known || info.si_pid == id_) {
        reap();
      } else if (Clock::now() >= deadline) {
        return false;
      } else {
        std::this_thread::sleep_for(pause);
        pause = std::min(2 * pause, std::chrono::milliseconds(50));
      }
    }
    return true;
  }

  // How it has ended.
  std::string end() const {
    if (WIFSIGNALED(status_)) return "ended by signal " + std::to_string(WTERMSIG(status_));
    return "ended with exit code " + std::to_string(WEXITSTATUS(status_));
  }

 private:
  void reap() {
    kill(-id_, SIGKILL);  // before its id can be reused
    while (waitpid(id_, &status_, 0) < 0 && errno == EINTR) continue;
    running_ = false;
  }

  pid_t id_ = -1;
  bool running_ = true;
  int status_ = 0;
};

std::optional<double> to_number(const std::map<std::string, std::string>& properties, const char* key) {
  const auto found = properties.find(key);
  if (found == properties.end()) return {};
  const std::vector<double> numbers = parse_numbers(found->second);
  if (numbers.size() != 1) return {};
  return numbers[0];
}

// Empty for the answers by which trackers say that they see no object.
std::optional<Region> to_reply_region(const std::string& text) {
  if (std::optional<Region> region = parse_region(text)) return region;
  const std::vector<double> numbers = parse_numbers(text);
  const bool nan = std::any_of(numbers.begin(), numbers.end(), [](double d) { return std::isnan(d); });
  if (numbers.size() == 1 || nan) return {};
  constexpr size_t kShown = 64;
  throw TraxError("answers with what is neither a rectangle nor a polygon: '" + text.substr(0, kShown) + "'");
}

bool contains(const std::vector<std::string>& items, std::string_view item) {
  return std::find(items.begin(), items.end(), item) != items.end();
}

}  // namespace

// The tracker and the connection to it.
class TraxClient::Process {
 public:
  Process(const std::string& command, const TraxClientOptions& options) : timeout_(options.timeout) {
    log_.reset(options.log.empty()
                   ? fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 0)
                   : open(options.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
    if (log_.get() < 0) throw_errno("cannot write " + options.log);
    if (options.socket) {
      Listener listener;
      const Descriptor null(open("/dev/null", O_RDONLY | O_CLOEXEC));
      child_.emplace(command, null.get(), log_.get(), log_.get(), listener.port());
      connect(listener);
    } else {
      // One socket for both directions, so that writing to a dead tracker gives an error code, not a signal.
      std::array<int, 2> ends;
      if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) throw_errno("socketpair");
      connection_.reset(ends[0]);
      const Descriptor theirs(ends[1]);
      child_.emplace(command, theirs.get(), theirs.get(), log_.get(), std::nullopt);
    }
    reader_.emplace(connection_.get());
  }

  // Anything that the tracker has sent before this message is not an answer to it.
  void send(const TraxMessage& message) {
    constexpr int kMost = 16;  // times 64 KiB, more than a socket holds; a tracker may print without end
    for (int i = 0; i < kMost && wait_for(connection_.get(), POLLIN, Clock::now()) != 0; ++i)
      if (!reader_->fill()) break;  // the connection is closed: sending reports that
    expect_nothing();
    send(message, after(timeout_));
    expect_nothing();  // nothing that came while the message was being sent
  }

  // The next message; a quit of the tracker is an error.
  TraxMessage receive() { return receive(after(timeout_)); }

  // Refuses messages that have already arrived: they would seem to answer the next one that is sent.
  void expect_nothing() {
    while (const std::optional<TraxMessage> message = take()) {
      throw TraxError("sends a " + std::string(to_string(message->type)) +
                      " that nothing asked for; an image is answered by one state for each object");
    }
  }

  // Tells the tracker to quit, if it still listens, and waits for its end.
  void quit() noexcept {
    const Clock::time_point deadline = Clock::now() + kPatience;
    try {
      send({Type::Quit, {}, {}}, deadline);
      shutdown(connection_.get(), SHUT_WR);
      child_->wait_until(deadline);
    } catch (...) {  // the process is ended in any case
    }
  }

 private:
  void connect(Listener& listener) {
    const Clock::time_point deadline = after(timeout_);
    constexpr std::chrono::milliseconds kStep(20);  // between checks whether the tracker has ended
    while (true) {
      connection_.reset(listener.accept_until(Clock::now() + kStep));
      if (connection_.get() >= 0) return;
      if (child_->wait_until(Clock::now())) throw TraxError(child_->end());
      if (Clock::now() > deadline) throw TraxError("does not connect in " + seconds());
    }
  }

  // The tracker's output is read meanwhile: it may print before it reads.
  void send(const TraxMessage& message, Clock::time_point deadline) {
    const std::string line = format_trax_message(message) + '\n';
    for (size_t sent = 0; sent < line.size();) {
      const short events = wait_for(connection_.get(), POLLIN | POLLOUT, deadline);
      if (events == 0 || Clock::now() >= deadline) throw TraxError("takes no message in " + seconds());
      if ((events & POLLIN) != 0 && !reader_->fill()) receive_last();
      if ((events & ~POLLIN) == 0) continue;
      const ssize_t count =
          ::send(connection_.get(), line.data() + sent, line.size() - sent, MSG_DONTWAIT | MSG_NOSIGNAL);
      if (count >= 0) {
        sent += static_cast<size_t>(count);
      } else if (errno == EPIPE || errno == ECONNRESET) {
        receive_last();
      } else if (errno != EAGAIN && errno != EINTR) {
        throw_errno("cannot be written to");
      }
    }
  }

  // The next message in the input read so far; lines before it that are not messages are printed. A quit of
  // the tracker is an error.
  std::optional<TraxMessage> take() {
    while (const std::optional<std::string> line = reader_->take()) {
      if (!is_trax_message(*line)) {
        print(*line + '\n');
        continue;
      }
      TraxMessage message = parse_trax_message(*line);
      if (message.type != Type::Quit) return message;
      const auto reason = message.properties.find("trax.reason");
      throw TraxError(reason == message.properties.end() ? "quits" : "quits: " + reason->second);
    }
    return {};
  }

  TraxMessage receive(Clock::time_point deadline) {
    while (true) {
      if (std::optional<TraxMessage> message = take()) return *std::move(message);
      if (Clock::now() >= deadline || wait_for(connection_.get(), POLLIN, deadline) == 0)
        throw TraxError("does not reply in " + seconds());
      if (!reader_->fill()) {
        const bool ended = child_->wait_until(Clock::now() + kPatience);
        throw TraxError(ended ? child_->end() : "closes the connection");
      }
    }
  }

  // The tracker has stopped reading; its last output may say why.
  [[noreturn]] void receive_last() {
    const Clock::time_point deadline = Clock::now() + kPatience;
    while (true) receive(deadline);
  }

  void print(std::string_view line) const {
    if (write(log_.get(), line.data(), line.size()) < 0) return;  // not worth an error
  }

  std::string seconds() const {
    std::array<char, 32> text;
    const auto end = std::to_chars(text.data(), text.data() + text.size(), timeout_).ptr;
    return std::string(text.data(), end) + " s";
  }

  double timeout_;
  Descriptor log_, connection_;
  std::optional<LineReader> reader_;
  std::optional<Child> child_;
};

TraxClient::TraxClient(std::string command, TraxClientOptions options)
    : command_(std::move(command)), options_(std::move(options)) {
  if (!(options_.timeout > 0)) throw std::invalid_argument("a timeout that is not positive");
  if (options_.name.empty()) options_.name = command_;
  guarded([&] { start(); });
}

TraxClient::~TraxClient() {
  if (process_) process_->quit();
}

TraxClient::TraxClient(TraxClient&&) noexcept = default;
TraxClient& TraxClient::operator=(TraxClient&&) noexcept = default;

template <class Call>
auto TraxClient::guarded(Call call) -> decltype(call()) {
  try {
    return call();
  } catch (const std::exception& e) {
    process_.reset();
    objects_ = 0;
    throw TraxError("tracker '" + options_.name + "': " + e.what());
  }
}

void TraxClient::start() {
  if (process_) process_->quit();
  process_.reset();
  objects_ = 0;
  process_ = std::make_unique<Process>(command_, options_);
  read_hello();
}

void TraxClient::read_hello() {
  const TraxMessage message = process_->receive();
  if (message.type != Type::Hello || !message.arguments.empty()) throw TraxError("does not say hello first");
  hello_ = message.properties;
  const auto list = [&](const char* key, const char* otherwise) {
    const auto found = hello_.find(key);
    const bool given = found != hello_.end() && !found->second.empty();
    return split_trax_list(given ? found->second : otherwise);
  };
  const double version = hello_.contains("trax.version") ? to_number(hello_, "trax.version").value_or(0) : 1;
  if (version != 1 && version != 2 && version != 3 && version != 4) {
    throw TraxError("speaks an unknown version of the protocol, " + hello_["trax.version"]);
  }
  version_ = static_cast<int>(version);
  image_formats_ = list("trax.image", "path");
  region_formats_ = list("trax.region", "rectangle");
  if (!contains(region_formats_, "rectangle") && !contains(region_formats_, "polygon")) {
    throw TraxError("takes neither rectangles nor polygons but " + hello_["trax.region"]);
  }
  if (list("trax.channels", "color") != std::vector<std::string>{"color"}) {
    throw TraxError("wants other channels than color: " + hello_["trax.channels"]);
  }
}

std::string TraxClient::region_argument(const Region& region) const {
  if (contains(region_formats_, region.is_rectangle() ? "rectangle" : "polygon")) return to_string(region);
  return to_string(region.is_rectangle() ? Region::polygon(region.points())
                                         : Region::rectangle(region.box()));
}

std::vector<TraxClient::Reply> TraxClient::initialize(const TraxImage& image,
                                                      const std::vector<Region>& objects) {
  if (objects.empty()) throw std::invalid_argument("no object to track");
  if (!process_ || (objects_ > 0 && (options_.restart || hello_.contains("vot")))) guarded([&] { start(); });
  const auto multiobject = hello_.find("trax.multiobject");
  if (objects.size() > 1 && (version_ < 4 || multiobject == hello_.end() || multiobject->second == "0")) {
    throw std::invalid_argument("tracker '" + options_.name + "' takes one object at a time");
  }
  const std::string pixels = encode_trax_image(image, image_formats_);
  return guarded([&] {
    if (version_ < 4) {
      process_->send({Type::Initialize, {pixels, region_argument(objects[0])}, {}});
    } else {
      if (objects_ > 0) process_->send({Type::Initialize, {}, {}});
      for (const Region& object : objects) {
        process_->send({Type::Initialize, {region_argument(object)}, {}});
      }
      process_->send({Type::Frame, {pixels}, {}});
    }
    objects_ = objects.size();
    return replies();
  });
}

std::vector<TraxClient::Reply> TraxClient::frame(const TraxImage& image) {
  if (objects_ == 0) throw std::logic_error("TraxClient::frame before initialize");
  const std::string pixels = encode_trax_image(image, image_formats_);
  return guarded([&] {
    process_->send({Type::Frame, {pixels}, {}});
    return replies();
  });
}

std::vector<TraxClient::Reply> TraxClient::replies() {
  std::vector<Reply> replies;
  while (replies.size() < objects_) {
    TraxMessage message = process_->receive();
    if (message.type != Type::State) {
      throw TraxError("answers with " + std::string(to_string(message.type)) + ", not with a state");
    }
    if (message.arguments.size() != 1) {
      throw TraxError("answers with a state of " + std::to_string(message.arguments.size()) + " regions");
    }
    replies.push_back({to_reply_region(message.arguments[0]), to_number(message.properties, "confidence"),
                       std::move(message.properties)});
  }
  process_->expect_nothing();
  return replies;
}

}  // namespace asterism::tools
