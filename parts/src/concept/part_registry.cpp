#include <dlfcn.h>
#include <elf.h>
#include <link.h>

#include <algorithm>
#include <array>
#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/concept/part_plugin.hpp>
#include <asterism/parts/concept/part_registry.hpp>
#include <asterism/solver/base/edit_distance.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

using Json = nlohmann::ordered_json;

// Sets options to their values in a JSON object.
class OptionReader : public OptionVisitor {
 public:
  OptionReader(std::string of, const Json& options, PartRegistry& models)
      : of_(std::move(of)), models_(models), levels_{{"", &options, {}}} {}

  void operator()(std::string_view name, double& value, const OptionRange&) override {
    if (const Json* json = find(name)) {
      if (!json->is_number()) refuse(name, "must be a number", *json);
      value = json->get<double>();
    }
  }
  void operator()(std::string_view name, int& value, const OptionRange&) override {
    if (const Json* json = find(name)) {
      constexpr auto kMost = std::numeric_limits<int>::max();
      if (!json->is_number_integer() || json->get<double>() > kMost || json->get<double>() < -kMost)
        refuse(name, "must be an integer", *json);
      value = json->get<int>();
    }
  }
  void operator()(std::string_view name, bool& value) override {
    if (const Json* json = find(name)) {
      if (!json->is_boolean()) refuse(name, "must be true or false", *json);
      value = json->get<bool>();
    }
  }
  void operator()(std::string_view name, std::uint64_t& value) override {
    if (const Json* json = find(name)) {
      if (!json->is_number_unsigned()) refuse(name, "must be an integer that is not negative", *json);
      value = json->get<std::uint64_t>();
    }
  }

  /// All options of this level have been visited: any other member is unknown.
  void leave() override {
    const Level& level = levels_.back();
    for (const auto& [name, value] : level.json->items())
      if (level.visited.empty())
        unknown(name, ": it has no options");
      else if (!level.visited.contains(name))
        unknown(name, detail::name_hint(level.path + name, level.paths()));
    levels_.pop_back();
  }

 private:
  struct Level {
    std::string path;
    const Json* json;
    std::set<std::string, std::less<>> visited;
    std::vector<std::string> paths() const {
      std::vector<std::string> all;
      for (const std::string& name : visited) all.push_back(path + name);
      return all;
    }
  };

  void made_by_name(std::string_view name, MemberReference member, std::string_view) override {
    const Json* json = find(name);
    if (json == nullptr) return;
    if (AnyPart* part = member.as<AnyPart>()) {
      *part = models_.make(part_of(name, *json));
    } else if (SolverDescription* solver = member.as<SolverDescription>()) {
      *solver = solver_of(name, *json, *solver);
    } else if (OptionText* option = member.as<OptionText>()) {
      if (!json->is_string()) refuse(name, "must be a text", *json);
      option->text = json->get<std::string>();
    }
  }
  // Returns NAME or NAME{OPTIONS} for a part.
  std::string part_of(std::string_view name, const Json& json) const {
    if (json.is_string()) return json.get<std::string>();
    if (!json.is_object() || !json.contains("model") || !json.at("model").is_string())
      refuse(name, "must be a part model's name or an object with it as \"model\"", json);
    Json options = json;
    options.erase("model");
    return json.at("model").get<std::string>() + options.dump();
  }
  // `json` is a solver's name, or an object with the name as "method" and options beside it; without "method"
  // the name of `now` is kept.
  SolverDescription solver_of(std::string_view name, const Json& json, const SolverDescription& now) const {
    if (json.is_string()) return {json.get<std::string>(), {}};
    if (!json.is_object()) refuse(name, "must be a solver's name or an object with it as \"method\"", json);
    SolverDescription solver{now.name, {}};
    for (const auto& [option, value] : json.items()) {
      if (option == "method" && value.is_string()) {
        solver.name = value.get<std::string>();
      } else if (value.is_boolean()) {
        solver.options.emplace_back(option, value.get<bool>());
      } else if (value.is_number_integer()) {
        solver.options.emplace_back(option, value.get<std::int64_t>());
      } else if (value.is_number()) {
        solver.options.emplace_back(option, value.get<double>());
      } else {
        const std::string near = detail::near_name(option, std::array{std::string("method")});
        if (!near.empty()) unknown(std::string(name) + '.' + option, near);
        refuse(std::string(name) + '.' + option, "must be a number, true or false", value);
      }
    }
    return solver;
  }
  const Json* find(std::string_view name) {
    levels_.back().visited.emplace(name);
    const auto at = levels_.back().json->find(name);
    return at == levels_.back().json->end() ? nullptr : &*at;
  }
  std::size_t choose(std::string_view name, std::size_t value,
                     std::initializer_list<std::string_view> names) override {
    const Json* json = find(name);
    if (json == nullptr) return value;
    const auto* at =
        json->is_string() ? std::find(names.begin(), names.end(), json->get<std::string>()) : names.end();
    if (at == names.end()) {
      std::string list;
      for (const std::string_view known : names)
        list += (list.empty() ? "\"" : ", \"") + std::string(known) + '"';
      refuse(name, "must be one of " + list, *json);
    }
    return static_cast<std::size_t>(at - names.begin());
  }
  void enter(std::string_view name) override {
    static const Json kNone = Json::object();
    const Json* json = find(name);
    if (json != nullptr && !json->is_object()) refuse(name, "must be an object", *json);
    levels_.push_back({levels_.back().path + std::string(name) + '.', json == nullptr ? &kNone : json, {}});
  }
  [[noreturn]] void unknown(const std::string& name, const std::string& hint) const {
    throw std::invalid_argument(of_ + ": unknown option '" + levels_.back().path + name + "'" + hint);
  }
  [[noreturn]] void refuse(std::string_view name, const std::string& what, const Json& found) const {
    throw std::invalid_argument(of_ + ": option '" + levels_.back().path + std::string(name) + "' " + what +
                                ", not " + found.dump());
  }

  std::string of_;
  PartRegistry& models_;
  std::vector<Level> levels_;
};

// The model that cannot be made with its defaults, as its networks are the user's.
constexpr char kSiamese[] = "siamese";

// Calls f.operator()<Model, Options>(NAME) for each of the library's models.
template <typename F>
void for_each_model(F&& f) {
  f.template operator()<ColorHistogram, ColorHistogramOptions>("color_histogram");
#ifdef ASTERISM_PARTS_FLOW
  f.template operator()<Flow, FlowOptions>("flow");
#endif
  f.template operator()<Kcf, KcfOptions>("kcf");
#ifdef ASTERISM_PARTS_KEYPOINTS
  f.template operator()<Keypoints, KeypointsOptions>("keypoints");
#endif
  f.template operator()<Mosse, MosseOptions>("mosse");
  f.template operator()<Siamese, SiameseOptions>(kSiamese);
  f.template operator()<SpatialReliability, SpatialReliabilityOptions>("spatial_reliability");
  f.template operator()<Strcf, StrcfOptions>("strcf");
  f.template operator()<Superpixels, SuperpixelsOptions>("superpixels");
  f.template operator()<Template, TemplateOptions>("template");
}

// Lists options with their values as JSON.
class OptionLister : public OptionVisitor {
 public:
  explicit OptionLister(Json& json) : levels_{&json} {}

  void operator()(std::string_view name, double& value, const OptionRange&) override { set(name, value); }
  void operator()(std::string_view name, int& value, const OptionRange&) override { set(name, value); }
  void operator()(std::string_view name, bool& value) override { set(name, value); }
  void operator()(std::string_view name, std::uint64_t& value) override { set(name, value); }

 private:
  void made_by_name(std::string_view name, MemberReference member, std::string_view made) override {
    Json json = std::string(made);
    if (const AnyPart* part = member.as<AnyPart>()) {
      for_each_model([&]<typename Model, typename Options>(const char* model) {
        const Model* const known = part->target<Model>();
        if (known == nullptr) return;
        json = Json::object();  // clang 14 leaks what `json = {...}` replaces in a template
        json["model"] = model;
        OptionLister lister(json);
        Options options = known->options();
        visit_options(lister, options);
      });
    } else if (const SolverDescription* solver = member.as<SolverDescription>();
               solver != nullptr && !solver->options.empty()) {
      json = {{"method", solver->name}};
      for (const NamedOption& option : solver->options)
        std::visit([&](auto value) { json[option.name] = value; }, option.value);
    }
    set(name, json);
  }
  void set(std::string_view name, const Json& value) { (*levels_.back())[std::string(name)] = value; }
  std::size_t choose(std::string_view name, std::size_t value,
                     std::initializer_list<std::string_view> names) override {
    set(name, std::string(names.begin()[value]));
    return value;
  }
  void enter(std::string_view name) override {
    set(name, Json::object());
    levels_.push_back(&(*levels_.back())[std::string(name)]);
  }
  void leave() override { levels_.pop_back(); }

  std::vector<Json*> levels_;
};

// Calls `f`, a plugin's code, and puts the name of the model in front of what it throws, unless it is there.
template <typename F>
auto guarded(const std::string& name, F&& f) {
  try {
    return f();
  } catch (const std::invalid_argument& error) {
    if (std::string_view(error.what()).starts_with(name + ": ")) throw;
    throw std::invalid_argument(name + ": " + error.what());
  } catch (const std::exception& error) {
    throw std::runtime_error(name + ": " + error.what());
  } catch (...) {
    throw std::runtime_error(name + ": an exception that is not a std::exception");
  }
}

// Wraps a plugin's model, whose results and exceptions are not trusted.
class PluginPart {
 public:
  PluginPart(std::string name, AnyPart part) : name_(std::move(name)), part_(std::move(part)) {}
  PluginPart(const PluginPart& other)
      : name_(other.name_), part_(guarded(other.name_, [&] { return other.part_; })) {}
  PluginPart(PluginPart&&) = default;
  PluginPart& operator=(const PluginPart& other) { return *this = PluginPart(other); }
  PluginPart& operator=(PluginPart&&) = default;
  ~PluginPart() = default;

  void init(const Frame& frame, const Point2& centre, const Size2& size) {
    guarded(name_, [&] { part_.init(frame, centre, size); });
  }
  Evidence localize(const Frame& frame, const Point2& around) {
    Evidence evidence = guarded(name_, [&] { return part_.localize(frame, around); });
    if (!evidence.position.allFinite() || !std::isfinite(evidence.peak) || !evidence.covariance.allFinite())
      throw std::runtime_error(name_ + ": evidence that is not finite");
    return evidence;
  }
  double similarity_at(const Point2& position) const {
    const double similarity = guarded(name_, [&] { return part_.similarity_at(position); });
    if (!std::isfinite(similarity)) throw std::runtime_error(name_ + ": a similarity that is not finite");
    return similarity;
  }
  void adapt(const Frame& frame, const Point2& at) {
    guarded(name_, [&] { part_.adapt(frame, at); });
  }
  const ResponseMap* response() const {
    return guarded(name_, [&] { return part_.response(); });
  }
  void resize(const Size2& size) {
    guarded(name_, [&] { part_.resize(size); });
  }
  bool stateful() const { return part_.stateful(); }
  void visit_state(StateArchive& archive) {
    guarded(name_, [&] { part_.visit_state(archive); });
  }

 private:
  std::string name_;
  AnyPart part_;
};

// Reads a section of a file in this machine's ELF format; nothing if it is not such a file or has no such
// section.
std::optional<std::string> elf_section(const std::string& path, std::string_view wanted) {
  constexpr std::uint64_t kMost = std::uint64_t{1} << 24;  // bytes of one table, e.g. 2^18 section headers
  std::ifstream file(path, std::ios::binary);
  const auto read = [&file](std::uint64_t at, std::uint64_t size) -> std::optional<std::string> {
    if (size > kMost || !file.seekg(static_cast<std::streamoff>(at))) return {};
    std::string bytes(size, '\0');
    if (!file.read(bytes.data(), static_cast<std::streamsize>(size))) return {};
    return bytes;
  };
  const auto bytes = read(0, sizeof(ElfW(Ehdr)));
  if (!bytes || !bytes->starts_with(ELFMAG)) return {};
  ElfW(Ehdr) header;
  std::memcpy(&header, bytes->data(), sizeof header);
  constexpr bool kWide = sizeof(header.e_shoff) == sizeof(std::uint64_t);
  if (header.e_ident[EI_CLASS] != (kWide ? ELFCLASS64 : ELFCLASS32)) return {};
  const auto table = read(header.e_shoff, std::uint64_t{header.e_shnum} * sizeof(ElfW(Shdr)));
  if (!table || header.e_shstrndx >= header.e_shnum) return {};
  std::vector<ElfW(Shdr)> sections(header.e_shnum);
  std::memcpy(sections.data(), table->data(), table->size());
  const auto names = read(sections[header.e_shstrndx].sh_offset, sections[header.e_shstrndx].sh_size);
  if (!names) return {};
  for (const ElfW(Shdr) & section : sections) {
    const std::string_view name =
        section.sh_name < names->size() ? std::string_view(*names).substr(section.sh_name) : "";
    if (name.substr(0, name.find('\0')) == wanted) return read(section.sh_offset, section.sh_size);
  }
  return {};
}

// Throws unless the file is a library of part models that was built for this program; does not load it.
void check_plugin(const std::string& library, const std::string& path) {
  const std::string is_none = library + " is not a library of part models: ";
  std::error_code error;
  if (!std::filesystem::exists(path, error))
    throw std::runtime_error("cannot load a library of part models: there is no file " + library);
  if (!std::filesystem::is_regular_file(path, error))
    throw std::runtime_error(is_none + "it is not a regular file");
  const std::optional<std::string> section = elf_section(path, ".asterism_part_plugin");
  if (!section)
    throw std::runtime_error(is_none +
                             "it has no section .asterism_part_plugin, which ASTERISM_PART_PLUGIN makes");
  std::string built = section->substr(0, section->find('\0'));
  if (built == ASTERISM_PART_PLUGIN_ABI) return;
  constexpr std::size_t kShown = 200;
  built.resize(std::min(built.size(), kShown));
  for (char& c : built)
    if (c < ' ' || c > '~') c = '?';
  throw std::runtime_error(library + " was built for " + built + ", this program for " +
                           ASTERISM_PART_PLUGIN_ABI);
}

}  // namespace

void detail::check_nesting(const std::string& of, std::string_view json) {
  constexpr int kMost = 100;
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < json.size(); ++i) {
    if (json[i] == '"') in_string = !in_string;
    if (in_string && json[i] == '\\') ++i;
    if (in_string) continue;
    if (json[i] == '{' || json[i] == '[') ++depth;
    if (json[i] == '}' || json[i] == ']') --depth;
    if (depth > kMost)
      throw std::invalid_argument(of + ": options nested more than " + std::to_string(kMost) + " deep");
  }
}

PartRegistry::PartRegistry() {
  for_each_model([this]<typename Model, typename Options>(const char* name) { add<Model, Options>(name); });
}

void PartRegistry::add(const std::string& name, Factory&& factory) {
  constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-";
  if (name.empty() || name.find_first_not_of(kLetters) != std::string::npos)
    throw std::invalid_argument("a part model's name must consist of letters, digits, '_' and '-', unlike '" +
                                name + "'");
  if (!factories_.try_emplace(name, std::move(factory)).second)
    throw std::invalid_argument("there is a part model '" + name + "' already");
}

std::vector<std::string> PartRegistry::load(const std::string& library) {
  // Without a slash, dlopen would search the system's folders.
  const std::string path = library.find('/') == std::string::npos ? "./" + library : library;
  check_plugin(library, path);
  // Never closed: parts and their exceptions may outlive any registry.
  void* const handle = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr)
    throw std::runtime_error("cannot load a library of part models: " + std::string(dlerror()));
  auto* const add_models =
      reinterpret_cast<void (*)(PartRegistry&)>(dlsym(handle, "asterism_part_plugin_add"));
  if (add_models == nullptr)
    throw std::runtime_error(library +
                             " is not a library of part models: it has no asterism_part_plugin_add");
  PartRegistry models{Factories()};
  try {
    guarded(library, [&] { add_models(models); });
  } catch (const std::invalid_argument& error) {  // a model's name was refused
    throw std::runtime_error(error.what());
  }
  std::vector<std::string> names;
  for (auto& [model, factory] : models.factories_) {
    names.push_back(library);
    names.back().append(1, ':').append(model);
    factories_.try_emplace(
        names.back(), [name = names.back(), factory = std::move(factory)](OptionVisitor& visit) {
          return [name, make = guarded(name, [&] { return factory(visit); })]() -> AnyPart {
            return PluginPart(name, guarded(name, [&] { return make(); }));
          };
        });
  }
  return names;
}

AnyPart PartRegistry::make(std::string_view model) {
  const std::size_t brace = std::min(model.find('{'), model.size());
  const std::string_view text = model.substr(0, brace);
  const std::string name(text.substr(0, text.find_last_not_of(' ') + 1));
  const Factory& factory = find(name);
  std::function<AnyPart()> part;
  read_json(name, brace < model.size() ? model.substr(brace) : "{}",
            [&](OptionVisitor& visit) { part = factory(visit); });
  try {
    return part();
  } catch (const std::invalid_argument& error) {
    if (std::string_view(error.what()).starts_with(name + ": ")) throw;
    throw std::invalid_argument(name + ": " + error.what());
  }
}

void PartRegistry::read_json(const std::string& of, std::string_view json, const Visit& options) {
  detail::check_nesting(of, json);
  Json object;
  try {
    object = Json::parse(json);
  } catch (const Json::exception& error) {  // also for a number beyond the range of double
    throw std::invalid_argument(of + ": its options are not a JSON object: " + error.what() +
                                " (an example is '" + of +
                                "{\"option\": 1}', which a shell needs in single quotes)");
  }
  if (!object.is_object())
    throw std::invalid_argument(of + ": its options are not a JSON object but " + object.dump());
  OptionReader reader(of, object, *this);
  options(reader);
  reader.leave();
}

std::string PartRegistry::list_json(const Visit& options) {
  Json json = Json::object();
  OptionLister lister(json);
  options(lister);
  return json.dump(2);
}

std::vector<std::string> PartRegistry::names() const {
  std::vector<std::string> names;
  for (const auto& [name, factory] : factories_)
    if (name != kSiamese) names.push_back(name);
  return names;
}

std::string PartRegistry::defaults(std::string_view name) { return list_json(find(name)); }

const PartRegistry::Factory& PartRegistry::find(std::string_view name) {
  auto at = factories_.find(name);
  if (const std::size_t colon = name.rfind(':'); at == factories_.end() && colon != std::string_view::npos) {
    load(std::string(name.substr(0, colon)));
    at = factories_.find(name);
  }
  if (at == factories_.end() && std::filesystem::is_regular_file(name)) {  // a plugin without its model
    std::string models;
    for (const std::string& model : load(std::string(name))) models += (models.empty() ? "" : " or ") + model;
    throw std::invalid_argument("'" + std::string(name) + "' is a plugin: give one of its models, " + models);
  }
  if (at == factories_.end())
    throw std::invalid_argument("unknown part model '" + std::string(name) + "'" +
                                detail::name_hint(name, names()));
  return at->second;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
