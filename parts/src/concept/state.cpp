#include <array>
#include <asterism/parts/concept/state.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

constexpr std::array<char, 8> kMark{'\x89', 'A', 's', 't', 'e', 'r', '\r', '\n'};
constexpr std::uint32_t kByteOrder = 0x01020304;
constexpr double kFarthest = 1e6, kSmallest = 1e-6;  // [px]

struct Header {
  std::array<char, 8> mark = kMark;
  std::uint32_t version = StateArchive::kVersion;
  std::uint32_t byte_order = kByteOrder;
  std::uint64_t size = 0;  // of the payload [bytes]
  std::uint32_t checksum = 0, reserved = 0;
};
static_assert(sizeof(Header) == 32);

// CRC-32 as in Ethernet and zlib.
std::uint32_t checksum_of(std::span<const std::byte> bytes) {
  static const auto table = [] {
    std::array<std::uint32_t, 256> result;
    for (std::uint32_t i = 0; i < 256; ++i) {
      result[i] = i;
      for (int k = 0; k < 8; ++k) result[i] = (result[i] >> 1) ^ (0xEDB88320 & (0 - (result[i] & 1)));
    }
    return result;
  }();
  std::uint32_t crc = ~std::uint32_t{0};
  for (const std::byte byte : bytes)
    crc = (crc >> 8) ^ table[(crc ^ std::to_integer<std::uint32_t>(byte)) & 255];
  return ~crc;
}

}  // namespace

StateArchive::StateArchive(std::span<const std::byte> bytes) : loading_(true) {
  Header header;
  if (bytes.size() < sizeof header || std::memcmp(bytes.data(), kMark.data(), kMark.size()) != 0)
    throw std::runtime_error("state: these bytes are not a saved state");
  std::memcpy(&header, bytes.data(), sizeof header);
  if (header.byte_order != kByteOrder)
    throw std::runtime_error("state: damaged, or saved on a machine of another byte order");
  if (header.version != kVersion)
    throw std::runtime_error("state: of format version " + std::to_string(header.version) +
                             ", this is version " + std::to_string(kVersion));
  payload_ = bytes.subspan(sizeof header);
  if (header.size != payload_.size() || header.reserved != 0)
    throw std::runtime_error("state: cut short or damaged: it has " + std::to_string(payload_.size()) +
                             " bytes, not the " + std::to_string(header.size) + " that it announces");
  if (header.checksum != checksum_of(payload_))
    throw std::runtime_error("state: damaged: its checksum does not match");
}

std::vector<std::byte> StateArchive::bytes() const {
  const Header header{.size = written_.size(), .checksum = checksum_of(written_)};
  std::vector<std::byte> result(sizeof header + written_.size());
  std::memcpy(result.data(), &header, sizeof header);
  std::copy(written_.begin(), written_.end(), result.begin() + sizeof header);
  return result;
}

void StateArchive::require(bool holds) const {
  if (holds) return;
  throw std::runtime_error(loading_ ? "state: its content is inconsistent"
                                    : "state: a number is not finite or beyond what can be saved");
}

void StateArchive::raw(void* data, std::size_t size) {
  auto* const bytes = static_cast<std::byte*>(data);
  if (!loading_) {
    written_.insert(written_.end(), bytes, bytes + size);
    return;
  }
  require(size <= payload_.size() - position_);
  std::memcpy(bytes, payload_.data() + position_, size);
  position_ += size;
}

void StateArchive::operator()(bool& value) {
  std::uint8_t byte = value;
  raw(&byte, 1);
  require(byte <= 1);
  value = byte != 0;
}

void StateArchive::operator()(int& value) {
  std::int32_t number = value;
  raw(&number, sizeof number);
  value = number;
}

void StateArchive::operator()(float& value) {
  raw(&value, sizeof value);
  require(std::isfinite(value));
}

void StateArchive::operator()(double& value) {
  raw(&value, sizeof value);
  require(std::isfinite(value));
}

void StateArchive::position(Point2& value) {
  (*this)(value);
  require((value.array().abs() <= kFarthest).all());
}

void StateArchive::size(Size2& value) {
  (*this)(value);
  require((value.array() >= kSmallest).all() && (value.array() <= kFarthest).all());
}

void StateArchive::count(int& value, std::size_t bytes_each) {
  (*this)(value);
  require(value >= 0);
  if (loading_) require(static_cast<std::size_t>(value) <= (payload_.size() - position_) / bytes_each);
}

void StateArchive::pixels(cv::Mat& image, const cv::Size& size, int channels) {
  const int type = CV_MAKETYPE(CV_8U, channels);
  if (loading_) image = cv::Mat(size, type);  // its own: copies of a model share pixels
  require(image.size() == size && image.type() == type);
  for (int row = 0; row < image.rows; ++row)
    raw(image.ptr(row), image.elemSize() * static_cast<std::size_t>(image.cols));
}

std::string StateArchive::text() {
  std::uint8_t length = 0;
  raw(&length, 1);
  std::string result(length, '\0');
  raw(result.data(), result.size());
  return result;
}

void StateArchive::name(std::string_view what) {
  std::string expected(what.substr(0, 255));
  if (!loading_) {
    auto length = static_cast<std::uint8_t>(expected.size());
    raw(&length, 1);
    raw(expected.data(), expected.size());
    return;
  }
  const std::string found = text();
  if (found == expected) return;
  const auto quoted = [](const std::string& part) { return part.empty() ? "an end" : "'" + part + "'"; };
  throw std::invalid_argument("state: of something else: it has " + quoted(found) + " where " +
                              quoted(expected) + " is");
}

// A part made by name is skipped: its own state holds its options.
void StateArchive::OptionCheck::made_by_name(std::string_view name, MemberReference member,
                                             std::string_view made) {
  const SolverDescription* const solver = member.as<SolverDescription>();
  if (solver == nullptr) return;
  archive_.name(name);
  archive_.name(made);
  for (const NamedOption& option : solver->options)
    check(option.name, std::visit([](auto value) { return static_cast<double>(value); }, option.value));
}

void StateArchive::OptionCheck::check(std::string_view name, double value) {
  archive_.name(name);
  double saved = value;
  archive_.raw(&saved, sizeof saved);  // raw, as an option may be infinite
  if (std::bit_cast<std::uint64_t>(saved) == std::bit_cast<std::uint64_t>(value)) return;
  throw std::invalid_argument("state: of other options: '" + std::string(name) + "' was " +
                              std::to_string(saved) + " and is " + std::to_string(value));
}

void throw_not_stateful(std::string_view what) {
  throw std::invalid_argument("state: this kind of " + std::string(what) + " cannot be saved");
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
