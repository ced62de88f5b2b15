// Runs the inputs in the folders on the command line through the fuzzer's entry point once each, so that what
// a fuzzer has found stays fixed without libFuzzer. With `--mutations N` also runs N random mutations of
// them, which needs neither clang nor its sanitizers; one that ends the process, or takes 20 s, is written to
// mutation.bin.

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <string_view>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace {

std::string input;  // the current one

void keep_input(int signal) {
  const int file = open("mutation.bin", O_WRONLY | O_CREAT | O_TRUNC, 0666);
  if (file < 0 || write(file, input.data(), input.size()) < 0)
    std::fputs("mutation.bin: not written\n", stderr);
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

void run(const std::string& bytes) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size());
}

class Mutator {
 public:
  explicit Mutator(const std::vector<std::string>& seeds) : seeds_(seeds) {}

  /// A seed with one to eight changes, of at most 4096 bytes.
  std::string next() {
    std::string bytes = seeds_[below(seeds_.size())];
    for (std::size_t changes = 1 + below(8); changes > 0; --changes) change(bytes);
    bytes.resize(std::min(bytes.size(), std::size_t{4096}));
    return bytes;
  }

 private:
  std::size_t below(std::size_t end) { return end == 0 ? 0 : random_() % end; }

  void change(std::string& bytes) {
    static constexpr std::array<std::string_view, 20> kTokens = {
        "-1",   "0",    "1e300", "1e-300", "nan", "inf", "2147483648", "9999999999999999999",
        "\"",   "{",    "}}}",   "[[[[",   ",",   "\n",  "\r",         " ",
        "/../", "true", "=",     "\\"};
    const std::size_t at = below(bytes.size() + 1),
                      length = below(std::min<std::size_t>(bytes.size() - at, 32) + 1);
    switch (below(7)) {
      case 0:
        if (at < bytes.size()) bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
        break;
      case 1:
        if (at < bytes.size()) bytes[at] = static_cast<char>(below(256));
        break;
      case 2:
        bytes.erase(at, length);
        break;
      case 3:  // duplicate
        bytes.insert(below(bytes.size() + 1), bytes.substr(at, length));
        break;
      case 4:
        bytes.insert(at, kTokens[below(kTokens.size())]);
        break;
      case 5:
        bytes.replace(at, length, kTokens[below(kTokens.size())]);
        break;
      default: {  // the end of another seed
        const std::string& other = seeds_[below(seeds_.size())];
        bytes.replace(at, std::string::npos, other.substr(below(other.size() + 1)));
      }
    }
  }

  const std::vector<std::string>& seeds_;
  std::mt19937_64 random_{1};
};

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> seeds;
  long mutations = 0;
  for (int i = 1; i < argc; ++i) {
    if (std::string_view(argv[i]) == "--mutations" && i + 1 < argc) {
      mutations = std::strtol(argv[++i], nullptr, 10);
      continue;
    }
    for (const auto& entry : std::filesystem::directory_iterator(argv[i])) {
      std::ifstream file(entry.path(), std::ios::binary);
      seeds.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
      std::fprintf(stderr, "%s\n", entry.path().c_str());  // the last one printed is the one that failed
      run(seeds.back());
    }
  }
  std::printf("%zu inputs\n", seeds.size());
  if (seeds.empty()) return 1;
  std::sort(seeds.begin(), seeds.end());  // directories are not sorted
  Mutator mutator(seeds);
  for (const int signal : {SIGABRT, SIGSEGV, SIGFPE, SIGBUS, SIGALRM}) std::signal(signal, keep_input);
  constexpr unsigned kMostSeconds = 20;
  for (long i = 0; i < mutations; ++i) {
    input = mutator.next();
    alarm(kMostSeconds);
    run(input);
  }
  if (mutations > 0) std::printf("%ld mutations\n", mutations);
  return 0;
}
