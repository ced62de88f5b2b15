// asterism-trax: runs a tracker for a TraX client, for instance the VOT toolkit.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>

#include "range_option.hpp"
#include "run_tool.hpp"
#include "tracker_option.hpp"
#include "trax_server.hpp"

namespace {

constexpr char kProgram[] = "asterism-trax";

[[noreturn]] void throw_errno(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), what);
}

// The number in an environment variable; `otherwise` if it is not set.
int number_from_environment(const char* name, int most, int otherwise) {
  const char* text = std::getenv(name);
  if (text == nullptr) return otherwise;
  int value = 0;
  const char* end = text + std::strlen(text);
  const auto [stop, error] = std::from_chars(text, end, value);
  if (error != std::errc{} || stop != end || value < 0 || value > most) {
    throw std::invalid_argument(std::string(name) + " is not a number from 0 to " + std::to_string(most));
  }
  return value;
}

// Connects to the client, which listens on a port of this machine.
int connect_to(int port) {
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  // Retries, as a client may start the tracker before it listens.
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(5);
  while (true) {
    const int descriptor = socket(AF_INET, SOCK_STREAM, 0);
    if (descriptor < 0) throw_errno("cannot open a socket");
    if (connect(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
      const int on = 1;  // replies are small, and the client waits for them
      setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      return descriptor;
    }
    const int error = errno;
    close(descriptor);
    if (error != ECONNREFUSED || std::chrono::steady_clock::now() > deadline) {
      throw std::system_error(error, std::generic_category(),
                              "cannot connect to port " + std::to_string(port));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
}

// Uses the streams or the socket that the environment variables name.
void serve(const asterism::tools::TraxServerOptions& options) {
  int in = -1, out = -1;
  if (std::getenv("TRAX_SOCKET") != nullptr) {
    in = out = connect_to(number_from_environment("TRAX_SOCKET", 65535, 0));
  } else {
    constexpr int kMostDescriptor = 1 << 20;
    in = number_from_environment("TRAX_IN", kMostDescriptor, STDIN_FILENO);
    out = dup(number_from_environment("TRAX_OUT", kMostDescriptor, STDOUT_FILENO));
    if (out < 0) throw_errno("cannot write to the client");
  }
  // Anything that a library prints goes to standard error: the client expects only the protocol.
  dup2(STDERR_FILENO, STDOUT_FILENO);
  asterism::tools::serve_trax(options, in, out);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace asterism::tools;
  std::signal(SIGPIPE, SIG_IGN);  // if the client exits, the write fails like any other

  TraxServerOptions options;
  CLI::App app("Runs a tracker for a client of the TraX protocol, on the standard streams or on TRAX_SOCKET.",
               kProgram);
  add_tracker_options(app, options.tracker);
  app.add_option("--trax-version", options.version,
                 "version of the protocol; 4 is needed for several objects")
      ->check(CLI::Range(1, 4))
      ->capture_default_str();
  add_range_options(app, options.range);
  app.set_version_flag("--version", ASTERISM_VERSION);
  return run_tool(app, argc, argv, [&] { serve(options); });
}
