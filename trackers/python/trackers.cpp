// Bindings of the trackers, whose images are NumPy arrays.

#include <pybind11/stl.h>

#include <algorithm>
#ifdef ASTERISM_PYTHON_PARTS
#include <asterism/parts/concept/part_registry.hpp>
#endif
#include <asterism/solver/base/counted.hpp>
#include <asterism/trackers/around/smooth_track.hpp>
#include <asterism/trackers/tracker/multi_tracker.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>

#include "../../solver/python/bindings.hpp"
#include "../../solver/python/pickling.hpp"

template <>
inline constexpr bool kIsBoundToPython<asterism::PartState> = true;
template <>
inline constexpr bool kIsBoundToPython<asterism::TrackResult> = true;

namespace asterism::python {

namespace {

/// The image's pixels without a copy if those of each row are contiguous; otherwise `copy` holds them.
cv::Mat mat_of(const py::object& image, py::array& copy) {
  if (!py::isinstance<py::array>(image)) {
    const char* hint = image.is_none() ? "; cv2.imread returns None for a file that it cannot read"
                       : py::hasattr(image, "getbands")  // Pillow's
                           ? "; numpy.asarray makes one of it, of which [..., ::-1] has blue first"
                           : py::isinstance<py::str>(image) ? "; cv2.imread reads one from a file" : "";
    throw py::type_error("image: expected a NumPy array, found " + type_name(image) + hint);
  }
  py::array array = unmasked(image, "image");
  const int depth = py::isinstance<py::array_t<std::uint8_t>>(array)    ? CV_8U
                    : py::isinstance<py::array_t<std::uint16_t>>(array) ? CV_16U
                    : py::isinstance<py::array_t<float>>(array)         ? CV_32F
                                                                        : -1;
  if (depth < 0) {
    throw py::type_error("image: expected uint8, uint16 or float32, found " +
                         py::str(array.dtype()).cast<std::string>() +
                         (array.dtype().kind() == 'f' ? "; convert it, in [0, 1], to float32" : ""));
  }
  const Shape shape = shape_of(array);
  const bool is_image =
      array.size() > 0 && (shape.size() == 2 || (shape.size() == 3 && shape[2] <= 4 && shape[2] != 2));
  if (!is_image || shape[0] > std::numeric_limits<int>::max() || shape[1] > std::numeric_limits<int>::max()) {
    throw py::value_error(
        "image: expected shape (height, width), (height, width, 3) in the order blue, green, red, "
        "or (height, width, 4), found " +
        text_of(shape));
  }
  const int channels = shape.size() == 3 ? static_cast<int>(shape[2]) : 1;
  const py::ssize_t pixel = channels * array.itemsize();
  const bool rows_are_whole = array.strides(1) == pixel && array.strides(0) >= shape[1] * pixel &&
                              (shape.size() == 2 || array.strides(2) == array.itemsize()) &&
                              array.strides(0) % array.itemsize() == 0;
  if (!rows_are_whole) array = copy = py::array::ensure(array, py::array::c_style);
  return cv::Mat(static_cast<int>(shape[0]), static_cast<int>(shape[1]), CV_MAKETYPE(depth, channels),
                 const_cast<void*>(array.data()), static_cast<std::size_t>(array.strides(0)));
}

/// Two numbers or None. Raises ValueError for a range that Frame would refuse.
std::optional<PixelRange> range_of(const py::object& range) {
  if (range.is_none()) return {};
  const auto [black, white] = numbers<2>(range, "pixel_range");
  const PixelRange found{black, white};
  const Frame check(cv::Mat::zeros(1, 1, CV_8UC1), found);
  return found;
}

/// The object's region in the first frame: x, y, width, height; the corners of a polygon, flat or (N, 2); or
/// a mask of bool or uint8 of the image's size. Raises ValueError for anything else, TypeError for masked
/// numbers.
Region region_of(const py::object& object, const cv::Size& image) {
  const auto refuse = [](const std::string& problem) {
    throw py::value_error("the object: expected " + problem);
  };
  const auto array = py::array::ensure(unmasked(object, "the object"));
  if (!array || std::string_view("biuf").find(array.dtype().kind()) == std::string_view::npos) {
    PyErr_Clear();
    refuse("numbers or a mask, found " + type_name(object));
  }
  const bool corners = array.ndim() == 1 || (array.ndim() == 2 && array.shape(1) == 2);
  if (array.ndim() == 2 && !corners &&
      (array.dtype().kind() == 'b' || array.dtype().is(py::dtype::of<uint8_t>()))) {
    if (array.shape(0) != image.height || array.shape(1) != image.width)
      throw py::value_error("the object: the mask has another size than the image");
    const auto mask = py::array_t<uint8_t, py::array::c_style | py::array::forcecast>(array);
    return Region::mask(cv::Mat(image, CV_8UC1, const_cast<uint8_t*>(mask.data())));
  }
  const auto values = numbers(array, "the object");
  const std::span<const double> all(values.data(), static_cast<std::size_t>(values.size()));
  if (!corners || (array.ndim() == 2 && array.shape(0) < 3) || all.size() < 4 || all.size() % 2 != 0) {
    refuse("x, y, width, height, the corners of a polygon, or a mask of bool or uint8, found " +
           py::str(array.dtype()).cast<std::string>() + " of shape " + text_of(shape_of(array)));
  }
  for (const double value : all) {
    if (!std::isfinite(value))
      refuse("finite numbers, found " + py::str(py::float_(value)).cast<std::string>());
  }
  if (all.size() == 4 && (all[2] < 0 || all[3] < 0)) {
    refuse("a width and height above 0, found " + py::str(py::float_(all[2])).cast<std::string>() + " x " +
           py::str(py::float_(all[3])).cast<std::string>());
  }
  const std::optional<Region> region = to_region(all);
  if (!region) refuse("at most 10,000 corners, found " + std::to_string(all.size() / 2));
  return *region;
}

/// The description that make_tracker and tracker_options take. Raises TypeError for options that are not a
/// dict of numbers, bools, names and dicts.
std::string description_of(const std::string& name, const py::object& options) {
  if (options.is_none()) return name;
  if (!py::isinstance<py::dict>(options)) {
    throw py::type_error("options: expected a dict or None, found " + shown(options));
  }
  const py::cpp_function number([](const py::object& value) {
    const py::object result = plain(value);
    if (!result.is(value)) return result;
    throw py::type_error("options: expected numbers, bools, names and dicts, found " + shown(value));
  });
  try {
    return name + py::module_::import("json")
                      .attr("dumps")(options, py::arg("allow_nan") = false, py::arg("default") = number)
                      .cast<std::string>();
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError)) throw;  // NaN, infinity, or a dict that contains itself
    throw py::value_error("options: expected finite numbers: " + py::str(error.value()).cast<std::string>());
  }
}

py::dict dict_of(const std::string& json) { return py::module_::import("json").attr("loads")(json); }

/// All options of the tracker with this description.
py::dict options_of(const std::string& description) {
  py::dict options = dict_of(tracker_options(description));
  options.attr("pop")("tracker");
  return options;
}

std::vector<std::string> part_names() {
#ifdef ASTERISM_PYTHON_PARTS
  return PartRegistry().names();
#else
  return {};
#endif
}

py::dict part_options(const std::string& name) {
#ifdef ASTERISM_PYTHON_PARTS
  return dict_of(PartRegistry().defaults(name));
#else
  throw py::value_error(name + ": options of part models need a build with nlohmann-json");
#endif
}

/// The arguments of a call, by position and by name: the first `required` must be given, the others default
/// to None. Used for functions that take images, as pybind11's own TypeError would print all arguments.
class Arguments {
 public:
  Arguments(const char* function, std::vector<const char*> names, std::size_t required, const py::args& args,
            const py::kwargs& kwargs)
      : function_(function), names_(std::move(names)), values_(names_.size()) {
    if (args.size() > names_.size()) {
      refuse("takes " + std::to_string(names_.size()) +
             (names_.size() == 1 ? " argument, but " : " arguments, but ") + std::to_string(args.size()) +
             " were given");
    }
    for (std::size_t i = 0; i < args.size(); ++i) values_[i] = args[i];
    for (const auto& [key, value] : kwargs) {
      const auto name = key.cast<std::string>();
      const auto found = std::find(names_.begin(), names_.end(), name);
      if (found == names_.end()) refuse("has no argument '" + name + "'");
      py::object& place = values_[static_cast<std::size_t>(found - names_.begin())];
      if (place) refuse("got argument '" + name + "' twice");
      place = py::reinterpret_borrow<py::object>(value);
    }
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (!values_[i] && i < required) refuse(std::string("misses argument '") + names_[i] + "'");
      if (!values_[i]) values_[i] = py::none();
    }
  }

  const py::object& operator[](std::size_t i) const { return values_[i]; }

  /// Argument i, converted.
  template <typename T>
  T as(std::size_t i, const char* expected) const {
    const bool is_number = !std::is_same_v<T, int> ||
                           (PyIndex_Check(values_[i].ptr()) != 0 && !py::isinstance<py::bool_>(values_[i]));
    try {
      if (is_number) return values_[i].template cast<T>();
    } catch (const py::cast_error&) {  // reported below
    }
    refuse(std::string("expected ") + expected + " as '" + names_[i] + "', found " + type_name(values_[i]));
  }

 private:
  [[noreturn]] void refuse(const std::string& problem) const {
    throw py::type_error(std::string(function_) + "() " + problem);
  }

  const char* function_;
  std::vector<const char*> names_;
  std::vector<py::object> values_;
};

/// asterism.Tracker.
class Tracker {
 public:
  using BoundToPython = void;

  Tracker(const std::string& name, const py::object& options, const py::object& range)
      : Tracker(name, description_of(name, options), range) {}

  const std::string& name() const { return name_; }
  py::dict options() const { return options_of(description_); }

  void init(const py::object& image, const py::object& box) {
    py::array copy;
    const cv::Mat mat = mat_of(image, copy);
    const Region region = region_of(box, mat.size());
    run([&] {
      if (range_)
        tracker_.init(Frame(mat, range_), region);
      else
        tracker_.init(mat, region);
      started_ = true;
    });
  }

  TrackResult update(const py::object& image) {
    py::array copy;
    const cv::Mat mat = mat_of(image, copy);
    TrackResult result;
    run([&] { result = range_ ? tracker_.update(Frame(mat, range_)) : tracker_.update(mat); });
    return result;
  }

  py::bytes save() {
    std::vector<std::byte> state;
    run([&] { state = tracker_.save(); });
    return {reinterpret_cast<const char*>(state.data()), state.size()};
  }

  void restore(const py::bytes& state) {
    const std::string_view bytes(state);
    run([&] {
      tracker_.restore(std::as_bytes(std::span(bytes)));
      started_ = true;
    });
  }

  py::tuple pickled() {
    const py::object state = started_ ? py::object(save()) : py::none();
    const py::object range = range_ ? py::object(py::make_tuple(range_->black, range_->white)) : py::none();
    return py::make_tuple(name_, description_, range, state);
  }

  static std::unique_ptr<Tracker> unpickled(const py::tuple& state) {
    const Fields fields(state, 4);
    std::unique_ptr<Tracker> made(
        new Tracker(fields[0].cast<std::string>(), fields[1].cast<std::string>(), fields[2]));
    if (!fields[3].is_none()) made->restore(fields[3]);
    return made;
  }

 private:
  Tracker(std::string name, std::string description, const py::object& range)
      : name_(std::move(name)),
        description_(std::move(description)),
        tracker_(make_tracker(description_)),
        range_(range_of(range)) {}

  template <typename F>
  void run(F&& f) {
    const Exclusive use(busy_, "this asterism.Tracker");
    const py::gil_scoped_release release;
    f();
  }

  std::string name_, description_;
  AnyTracker tracker_;
  bool started_ = false;
  std::optional<PixelRange> range_;
  bool busy_ = false;
};

/// asterism.MultiTracker.
class Objects {
 public:
  using BoundToPython = void;

  Objects(int threads, const py::object& range) : objects_(threads), range_(range_of(range)) {}

  void add(int id, const py::object& image, const py::object& box, const std::string& name,
           const py::object& options) {
    py::array copy;
    const cv::Mat mat = mat_of(image, copy);
    const Region region = region_of(box, mat.size());
    AnyTracker tracker = make_tracker(description_of(name, options));
    const Exclusive use(busy_, "this asterism.MultiTracker");
    const py::gil_scoped_release release;
    if (range_)
      objects_.add(id, std::move(tracker), Frame(mat, range_), region);
    else
      objects_.add(id, std::move(tracker), mat, region);
  }

  bool remove(int id) {
    const Exclusive use(busy_, "this asterism.MultiTracker");
    return objects_.remove(id);
  }

  std::size_t size() const { return objects_.size(); }

  py::dict update(const py::object& image) {
    py::array copy;
    const cv::Mat mat = mat_of(image, copy);
    const Exclusive use(busy_, "this asterism.MultiTracker");
    std::vector<MultiTracker::Object> objects;
    {
      const py::gil_scoped_release release;
      objects = objects_.update(Frame(mat, range_));
    }
    py::dict results;
    for (MultiTracker::Object& object : objects) {
      results[py::int_(object.id)] =
          object.error ? exception_of(object.error) : py::cast(std::move(object.result));
    }
    return results;
  }

 private:
  static py::object exception_of(const std::exception_ptr& error) {
    const py::object type = py::module_::import("builtins").attr("RuntimeError");
    try {
      std::rethrow_exception(error);
    } catch (const std::exception& e) {
      return type(e.what());
    } catch (...) {
      return type("unknown error");
    }
  }

  MultiTracker objects_;
  std::optional<PixelRange> range_;
  bool busy_ = false;
};

py::tuple tuple_of(const cv::Rect2d& box) { return py::make_tuple(box.x, box.y, box.width, box.height); }

py::array array_of(const Eigen::Vector2d& v) { return owned(v, {2}); }

py::array array_of(const std::array<cv::Point2d, 4>& corners) {
  py::array_t<double> result(Shape{4, 2});
  for (std::size_t i = 0; i < 4; ++i) {
    result.mutable_at(i, 0) = corners[i].x;
    result.mutable_at(i, 1) = corners[i].y;
  }
  return result;
}

py::tuple fields_of(const TrackResult& r) {
  const py::object covariance = r.covariance ? to_field(*r.covariance) : py::none();
  py::list links, times;
  for (const Link& link : r.links) links.append(py::make_tuple(link.i, link.j));
  for (const StageTime& time : r.times)
    times.append(py::make_tuple(std::string(time.stage), time.milliseconds));
  return py::make_tuple(tuple_of(r.box), r.angle, r.confidence, r.lost, r.interrupted, covariance,
                        r.certified, r.parts, r.update_threshold, links, times, r.probability, r.weak);
}

TrackResult result_of(const py::tuple& state) {
  const Fields fields(state, 13);
  TrackResult r;
  const auto box = fields[0].cast<std::array<double, 4>>();
  r.box = cv::Rect2d(box[0], box[1], box[2], box[3]);
  from_field(fields[1], r.angle);
  from_field(fields[2], r.confidence);
  from_field(fields[3], r.lost);
  from_field(fields[4], r.interrupted);
  if (!fields[5].is_none()) from_field(fields[5], r.covariance.emplace());
  from_field(fields[6], r.certified);
  from_field(fields[7], r.parts);
  from_field(fields[8], r.update_threshold);
  for (const auto& [i, j] : fields[9].cast<std::vector<std::pair<int, int>>>()) r.links.push_back({i, j});
  for (const auto& [stage, time] : fields[10].cast<std::vector<std::pair<std::string, double>>>())
    r.times.push_back({interned(stage), time});
  from_field(fields[11], r.probability);
  from_field(fields[12], r.weak);
  return r;
}

}  // namespace

void bind_trackers(py::module_& m) {
  py::class_<PartState> part_state(m, "PartState", "The state of one part after a frame.");
  def_copy(part_state);
  part_state
      .def_property_readonly(
          "position", [](const PartState& p) { return array_of(p.position); },
          "(x, y) in the MAP constellation [px].")
      .def_property_readonly(
          "size", [](const PartState& p) { return array_of(p.size); },
          "(width, height) of the part's template in the image [px].")
      .def_property_readonly(
          "visual_best", [](const PartState& p) { return array_of(p.visual_best); },
          "Visually most similar position (x, y) [px].")
      .def_readonly("weight", &PartState::weight, "Response at the position, compared by the update gate.")
      .def_readonly("updated", &PartState::updated, "The appearance model was updated in this frame.")
      .def(pickled<PartState>([](auto& p, auto&& field) {
        for (auto* point : {&p.position, &p.size, &p.visual_best}) field(*point);
        field(p.weight);
        field(p.updated);
      }))
      .def("__repr__", [](const PartState& p) {
        return std::string(cv::format("<asterism.PartState: position (%.2f, %.2f), weight %.3f%s>",
                                      p.position.x(), p.position.y(), p.weight,
                                      p.updated ? ", updated" : ""));
      });

  py::class_<TrackResult> track_result(m, "TrackResult", "A tracker's answer for one frame.");
  def_copy(track_result);
  track_result
      .def_property_readonly(
          "box", [](const TrackResult& r) { return tuple_of(r.box); },
          "(x, y, width, height) [px], upright; may reach over the frame's border.")
      .def_readonly("angle", &TrackResult::angle,
                    "By how much the object has turned since init [rad, from the x axis towards the y axis].")
      .def_readonly("confidence", &TrackResult::confidence, "In [0, 1].")
      .def_readonly("probability", &TrackResult::probability,
                    "That the box overlaps the object, in [0, 1]; 0 in an interrupted frame. None where the "
                    "tracker has none.")
      .def_readonly("lost", &TrackResult::lost,
                    "The tracker reports that it has lost the object; the box is its best guess.")
      .def_readonly("interrupted", &TrackResult::interrupted,
                    "The frame shows nothing of the scene: the box is that of the frame before.")
      .def_property_readonly(
          "covariance",
          [](const TrackResult& r) -> py::object {
            if (!r.covariance) return py::none();
            return owned(*r.covariance, {3, 3});
          },
          "Of the box's centre x, y [px] and of the logarithm of its size, (3, 3); None where unknown.")
      .def_readonly(
          "certified", &TrackResult::certified,
          "Whether the parts' placement is proven to be the one of least energy; None where the option "
          "certify did not ask.")
      .def_readonly("parts", &TrackResult::parts, "The parts, empty for trackers without.")
      .def_readonly("update_threshold", &TrackResult::update_threshold,
                    "Parts of less weight are not updated; 0 where no weight is compared.")
      .def_property_readonly(
          "links",
          [](const TrackResult& r) {
            py::array_t<int> links(Shape{static_cast<py::ssize_t>(r.links.size()), 2});
            for (std::size_t l = 0; l < r.links.size(); ++l) {
              links.mutable_at(l, 0) = r.links[l].i;
              links.mutable_at(l, 1) = r.links[l].j;
            }
            return links;
          },
          "The springs between parts, (L, 2).")
      .def_property_readonly(
          "times",
          [](const TrackResult& r) {
            py::dict times;
            for (const StageTime& t : r.times) {
              const py::str stage(std::string(t.stage));
              times[stage] = t.milliseconds + (times.contains(stage) ? times[stage].cast<double>() : 0);
            }
            return times;
          },
          "Milliseconds by stage.")
      .def_property_readonly("milliseconds", &TrackResult::milliseconds, "Their sum.")
      .def(
          "corners",
          [](const TrackResult& r, const PartState* part) {
            return array_of(part == nullptr ? r.corners() : r.corners(*part));
          },
          py::arg("part") = py::none(),
          "The box, or that of a part, as it is turned: (4, 2), those at the top left, top right, bottom\n"
          "right and bottom left while upright [px].")
      .def(
          "__bool__", [](const TrackResult& r) { return !r.lost; }, "Whether the object is not lost.")
      .def(py::pickle(&fields_of, &result_of))
      .def("__repr__", [](const TrackResult& r) {
        return py::str("<asterism.TrackResult: box ({:.2f}, {:.2f}, {:.2f}, {:.2f}), confidence {:.3f}{}>")
            .format(r.box.x, r.box.y, r.box.width, r.box.height, r.confidence, r.lost ? ", lost" : "");
      });

  m.def("tracker_names", &tracker_names, "The trackers of this build.");
  m.def(
      "tracker_options",
      [](const std::string& name, const py::object& options) {
        return options_of(description_of(name, options));
      },
      py::arg("name") = "dpt_plus", py::arg("options") = py::none(),
      "All options of Tracker(name, options) with their values, as the dict that Tracker takes; for\n"
      "`dpt+MODEL` as Tracker(\"dpt\", ..) takes it. ValueError as for Tracker.");
  m.def(
      "smooth_track",
      [](const py::object& box, const py::object& given, const py::object& shape) {
        cv::Size image;
        if (!shape.is_none()) {
          const auto sides = numbers(shape, "shape");
          const auto is_side = [](double side) { return side >= 1 && side <= 1e9; };
          if (sides.ndim() != 1 || sides.size() < 2 || !is_side(sides.at(0)) || !is_side(sides.at(1)))
            throw py::value_error("shape: expected the (height, width) of the images");
          image = {static_cast<int>(sides.at(1)), static_cast<int>(sides.at(0))};
        }
        std::vector<TrackResult> results(1);
        results[0].box = region_of(box, image).equal_area_box();
        const char* expected = "a list of TrackResults";
        for (const py::handle result :
             py::module_::import("asterism.inputs").attr("items")(given, "results", expected)) {
          if (!py::isinstance<TrackResult>(result))
            throw py::type_error("results: expected " + std::string(expected) + ", found " + shown(result));
          results.push_back(result.cast<TrackResult>());
        }
        results = smooth_track(results, image);
        results.erase(results.begin());
        return results;
      },
      py::arg("box"), py::arg("results"), py::arg("shape") = py::none(),
      "The results of a tracker, one for each frame after that of its init, with boxes and covariances that\n"
      "are smoothed after the fact, from the frames before and after each; the rest is as it was.\n\n"
      "box: as for init; it is exact. shape: image.shape; if it is given, centres are kept in the image.\n"
      "ValueError for a box that is not finite or has no size. See docs/tracker.md.");
  m.def("part_names", &part_names, "The part models of this build.");
  m.def("part_options", &part_options, py::arg("name"),
        "All options of a part model and their defaults, as a dict. ValueError for an unknown name.");
  m.def(
      "suggested_range",
      [](const py::object& image) -> std::optional<std::pair<double, double>> {
        py::array copy;
        const auto range = suggested_range(mat_of(image, copy));
        if (!range) return {};
        return std::pair(range->black, range->white);
      },
      py::arg("image"),
      "The (black, white) that a video's first image seems to need as pixel_range: of uint16 the fewest\n"
      "of 8, 10, 12 and 14 bits that hold its values, of float32 beyond 1 the fewest of 8 to 16 bits,\n"
      "else its least and greatest value. None where it needs none.");

  py::class_<Tracker> tracker(
      m, "Tracker",
      "A single-object tracker. Images are (height, width), (height, width, 3) in the order blue, green,\n"
      "red, or (height, width, 4), of uint8, uint16, or float32 in [0, 1] (values up to 1.5 are clipped,\n"
      "an image with values beyond is refused). They are not copied if the pixels of a row are\n"
      "contiguous. Boxes are (x, y, width, height) [px]. The GIL is released during computations.\n"
      "RuntimeError if two threads use a tracker at once. A copy, also one from a pickle, goes on by\n"
      "itself, bit for bit; ValueError for trackers that cannot be saved.");
  def_copy(tracker);
  tracker
      .def(
          py::init<const std::string&, const py::object&, const py::object&>(), py::arg("name") = "dpt_plus",
          py::arg("options") = py::none(), py::arg("pixel_range") = py::none(),
          "name: one of tracker_names() or `dpt+MODEL`. options: a dict of the options of its class, for "
          "`dpt+MODEL`\n"
          "of those of MODEL; options of both are written Tracker(\"dpt\", {\"part\": {\"model\": MODEL, "
          "..}, ..}).\n"
          "pixel_range: the (black, white) values of all images, e.g. (0, 4095) for 12 bits in uint16, whose "
          "default\n"
          "are all 16: a first image of uint16 up to 255 alone is refused.\n"
          "ValueError names what is wrong.")
      .def(py::pickle([](Tracker& self) { return self.pickled(); }, &Tracker::unpickled))
      .def("save", &Tracker::save,
           "The state between two frames, as bytes. RuntimeError before init, ValueError for trackers that "
           "cannot be saved.")
      .def("restore", &Tracker::restore, py::arg("state"),
           "Continues as the tracker that `state` was saved from, bit for bit; name and options must be the\n"
           "same. RuntimeError for bytes that are not a state, ValueError for the state of something else.")
      .def_property_readonly("name", &Tracker::name, "The tracker's name.")
      .def("options", &Tracker::options,
           "All options with their values, as tracker_options(name, options) has them.")
      .def("__repr__", [](const Tracker& self) { return "<asterism.Tracker: " + self.name() + ">"; });

  {
    py::options options;
    options.disable_function_signatures();
    tracker
        .def(
            "init",
            [](Tracker& self, const py::args& args, const py::kwargs& kwargs) {
              const Arguments given("init", {"image", "box"}, 2, args, kwargs);
              self.init(given[0], given[1]);
            },
            "init(self: asterism.Tracker, image: numpy.ndarray, box: object) -> None\n\n"
            "Start on an object; may be called again at any time. box: x, y, width, height; or the corners\n"
            "of a polygon, x1, y1, x2, y2, .. or (N, 2); or a mask, (height, width) of bool or uint8. Of a\n"
            "polygon or a mask the upright box of the same area and centre is followed. ValueError, and\n"
            "the former state, for what is not finite, smaller than 1 x 1 or off the image, and where the\n"
            "box and its surroundings, of twice its sides, have one gray level or color. Noise is not\n"
            "refused: start in a frame that shows the object.")
        .def(
            "update",
            [](Tracker& self, const py::args& args, const py::kwargs& kwargs) {
              return self.update(Arguments("update", {"image"}, 1, args, kwargs)[0]);
            },
            "update(self: asterism.Tracker, image: numpy.ndarray) -> asterism.TrackResult\n\n"
            "The object in the next image. RuntimeError before init.");
  }

  py::class_<Objects> objects(
      m, "MultiTracker",
      "Several objects in one video, each with a tracker of its own, in parallel; results are those\n"
      "of single trackers, bit for bit. Images and boxes as for Tracker.");
  def_reduce(objects);
  objects
      .def(py::init<int, const py::object&>(), py::arg("threads").noconvert() = 1,
           py::arg("pixel_range") = py::none(),
           "threads: 0 for as many as the machine runs at once. pixel_range: as for Tracker.")
      .def("remove", &Objects::remove, py::arg("id").noconvert(), "False if there is no object of that id.")
      .def("__len__", &Objects::size)
      .def("__repr__", [](const Objects& self) {
        return "<asterism.MultiTracker: " + detail::counted(static_cast<int>(self.size()), "object") + ">";
      });
  py::options options;
  options.disable_function_signatures();
  objects
      .def(
          "add",
          [](Objects& self, const py::args& args, const py::kwargs& kwargs) {
            const Arguments given("add", {"id", "image", "box", "name", "options"}, 3, args, kwargs);
            const std::string name = given[3].is_none() ? "dpt_plus" : given.as<std::string>(3, "a str");
            self.add(given.as<int>(0, "an integer"), given[1], given[2], name, given[4]);
          },
          "add(self: asterism.MultiTracker, id: int, image: numpy.ndarray, box: object, name: str = "
          "'dpt_plus', options: object = None) -> None\n\n"
          "Follow an object from this image on, by a tracker of this name and options. ValueError where\n"
          "there is one of that id, and what Tracker and its init raise.")
      .def(
          "update",
          [](Objects& self, const py::args& args, const py::kwargs& kwargs) {
            return self.update(Arguments("update", {"image"}, 1, args, kwargs)[0]);
          },
          "update(self: asterism.MultiTracker, image: numpy.ndarray) -> dict\n\n"
          "A dict from ids to TrackResult in the next image, or to the exception that the object's\n"
          "tracker ended with; the others do not notice.");
}

}  // namespace asterism::python
