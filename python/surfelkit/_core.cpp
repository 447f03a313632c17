// The module: exceptions, calls that let go of the interpreter, threads, options.

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>

#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/version.h>
#include <surfel/io/named_file.h>

#include "_columns.h"

namespace surfel::python {
namespace {

/// Exceptions by ErrorKind; they live as long as the process.
struct Exceptions {
  PyObject* base = nullptr;
  PyObject* usage = nullptr;
  PyObject* input = nullptr;
  PyObject* file = nullptr;
  PyObject* numeric = nullptr;
};
Exceptions& exceptions() {
  static Exceptions all;
  return all;
}

PyObject* make_exception(py::module_& module, const char* name, const char* about,
                         const py::tuple& bases) {
  const std::string full = std::string("surfelkit.") + name;
  PyObject* made = PyErr_NewExceptionWithDoc(full.c_str(), about, bases.ptr(), nullptr);
  if (!made) throw py::error_already_set();
  module.attr(name) = py::handle(made);
  return made;
}

void bind_exceptions(py::module_& module) {
  const auto with = [](PyObject* kind) {
    return py::make_tuple(py::handle(exceptions().base), py::handle(kind));
  };
  Exceptions& all = exceptions();
  all.base = make_exception(module, "Error", "Base of all errors of Surfelkit.",
                            py::make_tuple(py::handle(PyExc_Exception)));
  all.usage = make_exception(module, "UsageError",
                             "Arguments are out of range or contradict each other; a ValueError.",
                             with(PyExc_ValueError));
  all.input = make_exception(module, "InputError",
                             "The content of a file or of arrays is wrong; a ValueError.",
                             with(PyExc_ValueError));
  all.file =
      make_exception(module, "FileError", "A file cannot be opened, read or written; an OSError.",
                     with(PyExc_OSError));
  all.numeric = make_exception(module, "NumericError",
                               "A computation failed on valid input; an ArithmeticError.",
                               with(PyExc_ArithmeticError));
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
      const Exceptions& known = exceptions();
      PyObject* kind = known.base;
      switch (error.kind()) {
        case ErrorKind::kUsage:
          kind = known.usage;
          break;
        case ErrorKind::kInput:
          kind = known.input;
          break;
        case ErrorKind::kIo:
          kind = known.file;
          break;
        case ErrorKind::kNumeric:
          kind = known.numeric;
          break;
        case ErrorKind::kInterrupted:
          kind = PyExc_KeyboardInterrupt;
          break;
      }
      PyErr_SetObject(kind, text_of(error.what()).ptr());
    }
  });
}

/// The stages that work of this process is in, for progress callbacks.
class Stages final : public ProgressObserver {
 public:
  void begin(const ProgressStage& stage) override {
    const std::lock_guard lock(mutex_);
    open_.push_back(&stage);
  }
  void end(const ProgressStage& stage) noexcept override {
    const std::lock_guard lock(mutex_);
    std::erase(open_, &stage);
    if (listeners_ == 0) return;
    try {
      if (std::find(ended_.begin(), ended_.end(), stage.name()) == ended_.end()) {
        ended_.push_back(stage.name());
      }
    } catch (const std::bad_alloc&) {
      return;  // The callback misses the end of a stage.
    }
  }
  void listen(int more) {
    const std::lock_guard lock(mutex_);
    listeners_ += more;
    if (listeners_ == 0) ended_.clear();
  }
  /// The stages that ended since the last call, and the innermost one that is open, with the share
  /// of each that is done.
  std::vector<std::pair<std::string, double>> news() {
    const std::lock_guard lock(mutex_);
    std::vector<std::pair<std::string, double>> all;
    for (std::string& name : ended_) all.emplace_back(std::move(name), 1.0);
    ended_.clear();
    if (!open_.empty() && open_.back()->total() > 0) {
      const ProgressStage& last = *open_.back();
      all.emplace_back(last.name(), std::min(1.0, static_cast<double>(last.done()) /
                                                      static_cast<double>(last.total())));
    }
    return all;
  }

 private:
  std::mutex mutex_;
  std::vector<const ProgressStage*> open_;
  std::vector<std::string> ended_;
  int listeners_ = 0;
};

Stages& stages() {
  static Stages all;
  return all;
}

/// A thread that works, and whoever waits for it.
class Worker {
 public:
  explicit Worker(const std::function<void()>& work)
      : thread_([this, &work] {
          try {
            work();
          } catch (...) {
            failure_ = std::current_exception();
          }
          const std::lock_guard lock(mutex_);
          done_ = true;
          changed_.notify_all();
        }) {}
  ~Worker() { thread_.join(); }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// Waits for the end of the work, but not longer than that; has it ended?
  bool wait(std::chrono::milliseconds most) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, most, [this] { return done_; });
  }
  void wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return done_; });
  }
  void rethrow() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool done_ = false;
  std::exception_ptr failure_;
  std::thread thread_;  ///< The last member: it uses the others.
};

/// Sets the threads of the process for a call, and sets them back.
class Threads {
 public:
  explicit Threads(std::optional<int> threads) : before_(thread_count()) {
    if (!threads) return;
    if (*threads < 1 || *threads > kMostThreads) {
      throw_usage("`threads` is " + std::to_string(*threads) + "; it must be in 1.." +
                  std::to_string(kMostThreads));
    }
    changed_ = true;
    set_thread_count(*threads);
  }
  ~Threads() {
    if (changed_) set_thread_count(before_);
  }
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

 private:
  int before_;
  bool changed_ = false;
};

/// Hears of stages while it lives, if there is a callback.
class Listening {
 public:
  explicit Listening(bool on) : on_(on) {
    if (on_) stages().listen(1);
  }
  ~Listening() {
    if (on_) stages().listen(-1);
  }
  Listening(const Listening&) = delete;
  Listening& operator=(const Listening&) = delete;

 private:
  bool on_;
};

void tell(const py::object& progress) {
  for (const auto& [name, share] : stages().news()) progress(text_of(name), share);
}

void bind_threads(py::module_& module) {
  module.def(
      "thread_count", [] { return thread_count(); },
      "Threads that work is shared by; no result depends on their number.");
  module.def(
      "set_thread_count",
      [](std::optional<int> threads) {
        if (threads && (*threads < 1 || *threads > kMostThreads)) {
          throw_usage("`threads` is " + std::to_string(*threads) + "; it must be in 1.." +
                      std::to_string(kMostThreads) + ", or None");
        }
        set_thread_count(threads.value_or(0));
      },
      py::arg("threads"),
      "Sets the threads of all calls of the process, 1 to 1024; None: one for each core.");
}

void bind_names(py::module_& module) {
  module.def(
      "allow_outside", [](bool allowed) { allow_outside(allowed); }, py::arg("allowed"),
      "Lets files name images and other files outside of their folders, in all calls of the "
      "process; False at its start.");
}

/// An object that __new__ made and no __init__ filled has no value; pybind11 would give it memory
/// that was never set as soon as it is used.
void refuse_empty_objects(const py::module_& module) {
  for (const auto& [name, value] : module.attr("__dict__").cast<py::dict>()) {
    if (!py::isinstance<py::type>(value)) continue;
    auto* const type = reinterpret_cast<PyTypeObject*>(value.ptr());
    if (py::detail::type_info* const info = py::detail::get_type_info(type)) {
      info->operator_new = [](std::size_t) -> void* {
        throw py::type_error("the object has no value: it was made by __new__ without __init__");
      };
    }
  }
}

}  // namespace

void run(const Call& call, const std::function<void()>& work) {
  constexpr std::chrono::milliseconds kPause(50);
  const Threads threads(call.threads);
  const bool told = !call.progress.is_none();
  const Listening listening(told);
  // Kept until the worker has ended, which must not happen with the interpreter held.
  std::optional<py::error_already_set> raised;
  {
    const py::gil_scoped_release release;
    Worker worker(work);
    while (!worker.wait(kPause)) {
      const py::gil_scoped_acquire acquire;
      try {
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        if (told) tell(call.progress);
      } catch (py::error_already_set& error) {
        raised.emplace(std::move(error));
        break;
      }
    }
    if (raised) {
      request_interrupt();
      worker.wait();
      withdraw_interrupt();
    } else {
      worker.rethrow();
    }
  }
  if (raised) throw py::error_already_set(std::move(*raised));
  if (told) tell(call.progress);
}

void Options::refuse(bool unheeded, const std::vector<const char*>& names,
                     const std::string& where) const {
  if (!unheeded) return;
  for (const char* name : names) {
    if (std::find(changed_.begin(), changed_.end(), name) != changed_.end()) {
      throw_usage("`" + std::string(name) + "` has no effect " + where + "; leave it out");
    }
  }
}

void Options::visit(const char* name, const std::function<py::object()>& get,
                    const std::function<void(const py::object&)>& set) {
  const py::object before = get();
  if (!takes_) {
    listed_[name] = before;
    return;
  }
  const auto given = given_[name].cast<py::object>();
  try {
    set(given);
  } catch (const py::cast_error&) {
    throw_usage("`" + std::string(name) + "` is " + std::string(py::repr(given)) +
                "; it must be of the type " +
                (before.is_none() ? "that its description tells, or None"
                                  : std::string(py::str(py::type::of(before).attr("__name__")))));
  }
  if (!get().equal(before)) changed_.emplace_back(name);
}

void Options::operator()(const char* name, std::optional<Vec3d>& value) {
  visit(
      name,
      [&]() -> py::object {
        if (!value) return py::none();
        return py::make_tuple(value->x(), value->y(), value->z());
      },
      [&](const py::object& given) {
        const auto numbers = given.cast<std::optional<std::array<double, 3>>>();
        value = numbers ? std::optional(Vec3d(numbers->data())) : std::nullopt;
      });
}

void Options::operator()(const char* name, Vec3d& value) {
  visit(
      name, [&] { return py::make_tuple(value.x(), value.y(), value.z()); },
      [&](const py::object& given) { value = Vec3d(given.cast<std::array<double, 3>>().data()); });
}

void Options::refuse_choice(const char* name, const py::object& given, const std::string& known) {
  throw_usage("`" + std::string(name) + "` is " + std::string(py::repr(given)) +
              "; it must be one of " + known);
}

void with_names(const std::vector<std::pair<std::string, std::string>>& names,
                const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kUsage) throw;
    std::string text = error.what();
    for (const auto& [field, argument] : names) {
      const std::string from = "`" + field + "`";
      const std::string to = "`" + argument + "`";
      for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) {
        text.replace(at, from.size(), to);
      }
    }
    throw Error(ErrorKind::kUsage, text);
  }
}

py::str text_of(const std::string& text) {
  return py::reinterpret_steal<py::str>(
      PyUnicode_DecodeUTF8(text.data(), static_cast<py::ssize_t>(text.size()), "surrogateescape"));
}

std::string text_of(const py::dtype& type) { return py::str(py::handle(type)); }

std::string shape_text(const std::vector<py::ssize_t>& shape) {
  std::string text;
  for (const py::ssize_t side : shape) {
    text += (text.empty() ? "" : ", ") + (side < 0 ? std::string("N") : std::to_string(side));
  }
  return "(" + text + (shape.size() == 1 ? ",)" : ")");
}

py::array as_array(const py::object& given) {
  return py::module_::import("numpy").attr("asarray")(given);
}

py::array values_of(const py::object& given, const py::dtype& type,
                    const std::vector<py::ssize_t>& shape, const std::string& name) {
  const py::array array = as_array(given);
  const char kind = array.dtype().kind();
  const bool whole = kind == 'i' || kind == 'u' || kind == 'b';
  const bool to_whole = type.kind() != 'f';
  if (!whole && (to_whole || kind != 'f')) {
    throw_input("", "`" + name + "` has the type " + text_of(array.dtype()) + "; it must be of " +
                        (to_whole ? "whole" : "real") + " numbers");
  }
  bool fits = array.ndim() == static_cast<py::ssize_t>(shape.size());
  for (py::ssize_t i = 0; fits && i < array.ndim(); ++i) {
    const py::ssize_t side = shape[static_cast<std::size_t>(i)];
    fits = side < 0 || side == array.shape(i);
  }
  if (!fits) {
    const std::vector<py::ssize_t> found(array.shape(), array.shape() + array.ndim());
    throw_input("", "`" + name + "` has the shape " + shape_text(found) + "; it must be " +
                        shape_text(shape));
  }
  if (to_whole && array.size() > 0) {
    const py::object limits = py::module_::import("numpy").attr("iinfo")(type);
    const py::object least = array.attr("min")().attr("item")();
    const py::object most = array.attr("max")().attr("item")();
    if (least < limits.attr("min") || most > limits.attr("max")) {
      throw_input("", "`" + name + "` has the values " + std::string(py::str(least)) + " to " +
                          std::string(py::str(most)) + ", which do not fit its type " +
                          text_of(type));
    }
  }
  return array.attr("astype")(type, "C");
}

py::array linear_colors(const py::object& given, const std::vector<py::ssize_t>& shape,
                        const std::string& name) {
  const py::array array = as_array(given);
  const py::dtype type = array.dtype();
  const bool coded = type.kind() == 'u' && type.itemsize() <= 2;
  if (!coded && type.kind() != 'f') {
    throw_input("", "`" + name + "` has the type " + text_of(type) +
                        "; give floats, which are linear light, or sRGB codes as uint8 or uint16");
  }
  if (!coded) return values_of(given, py::dtype::of<float>(), shape, name);
  const py::array codes = values_of(given, type, shape, name);
  const std::vector<py::ssize_t> sides(codes.shape(), codes.shape() + codes.ndim());
  py::array_t<float> out(sides);
  float* const to = out.mutable_data();
  const auto size = static_cast<std::size_t>(codes.size());
  if (type.itemsize() == 1) {
    const auto* const from = static_cast<const std::uint8_t*>(codes.data());
    std::transform(from, from + size, to, srgb8_to_linear);
  } else {
    const auto* const from = static_cast<const std::uint16_t*>(codes.data());
    std::transform(from, from + size, to, srgb16_to_linear);
  }
  return out;
}

Array<std::uint32_t> rows_chosen(const py::object& key, std::size_t rows) {
  const py::module_ numpy = py::module_::import("numpy");
  const py::object chosen = numpy.attr("arange")(rows, py::arg("dtype") = "uint32")[key];
  const py::array array = numpy.attr("ascontiguousarray")(chosen);
  if (!py::isinstance<py::array>(chosen) || py::array(chosen).ndim() != 1) {
    throw py::type_error("parts of clouds are chosen by a slice, a mask or an array of indices");
  }
  const auto* const data = static_cast<const std::uint32_t*>(array.data());
  return {data, data + array.size()};
}

py::object tuple_of(const std::optional<Vec3d>& v) {
  if (!v) return py::none();
  return py::make_tuple(v->x(), v->y(), v->z());
}
}  // namespace surfel::python

PYBIND11_MODULE(_core, module) {
  using namespace surfel::python;
  module.attr("__version__") = surfel::version();
  bind_exceptions(module);
  surfel::set_progress_observer(&stages());
  bind_threads(module);
  bind_names(module);
  bind_surfels(module);
  bind_meshes(module);
  bind_gaussians(module);
  bind_pictures(module);
  bind_files(module);
  bind_work(module);
  refuse_empty_objects(module);
}
