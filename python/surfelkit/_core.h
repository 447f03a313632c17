#pragma once

// What the sources of the module share: objects whose arrays NumPy sees, calls that let go of the
// interpreter, and options by name.

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <surfel/base/error.h>
#include <surfel/base/types.h>
#include <surfel/scene/gaussian_cloud.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/triangle_mesh.h>

namespace surfel::python {

namespace py = pybind11;

/// An object of the library whose arrays NumPy may see. A view keeps the object alive, so that its
/// arrays neither move nor go while the object lives: a column gets values in its place, and the
/// memory of one that is taken away stays until the object goes.
template <class T>
struct Held {
  T value;
  std::vector<std::shared_ptr<void>> retired;  ///< Columns that were taken away.
  int users = 0;                               ///< Calls that work on it; see InUse.
  /// A hash of the positions when a view of them was first given out, where the cloud says what is
  /// true of unmoved ones alone; see ready().
  std::optional<std::size_t> positions_seen;
};
using HeldCloud = Held<SurfelCloud>;
using HeldMesh = Held<TriangleMesh>;
using HeldGaussians = Held<GaussianCloud>;

/// While it lives, columns of an object are neither added nor taken away. Made and destroyed with
/// the interpreter held.
template <class T>
class InUse {
 public:
  explicit InUse(Held<T>& held) : held_(held) { ++held_.users; }
  ~InUse() { --held_.users; }
  InUse(const InUse&) = delete;
  InUse& operator=(const InUse&) = delete;

 private:
  Held<T>& held_;
};

/// Throws where a call of another thread works on the object.
template <class T>
void require_unused(const Held<T>& held) {
  if (held.users > 0) {
    throw std::runtime_error(
        "the object is in use by a call of another thread; change its columns when that is done");
  }
}

template <class T>
std::shared_ptr<Held<T>> hold(T value) {
  auto held = std::make_shared<Held<T>>();
  held->value = std::move(value);
  return held;
}

/// How a call is made: all that is no option of the work itself.
struct Call {
  py::object progress;         ///< Called with the stage and the share of it that is done, or None.
  std::optional<int> threads;  ///< Unset: as set_thread_count() has it.
};

/// Runs work of the library on a thread of its own without the interpreter. Signals are heeded
/// meanwhile: an exception of a signal handler (Ctrl-C) or of the progress callback ends the work,
/// and is thrown here.
void run(const Call& call, const std::function<void()>& work);
inline void run(const std::function<void()>& work) { run({py::none(), std::nullopt}, work); }

/// The work's result.
template <class Make>
auto made(const Call& call, const Make& make) {
  std::optional<decltype(make())> result;
  run(call, [&] { result.emplace(make()); });
  return std::move(*result);
}
template <class Make>
auto made(const Make& make) {
  return made({py::none(), std::nullopt}, make);
}

/// A name as Python has it for a choice of the library.
template <class E>
using Choices = std::vector<std::pair<const char*, E>>;

/// Takes options by name out of a dict, or puts them into it: a function that visits the members of
/// an options struct serves for both, so that defaults stand in the struct alone.
class Options {
 public:
  /// Lists: values of members go into the dict.
  Options() = default;
  /// Takes: values of the dict go into members. Throws Error(kUsage) where one is of a wrong type.
  explicit Options(py::dict given) : given_(std::move(given)), takes_(true) {}

  template <class T>
  void operator()(const char* name, T& value) {
    visit(
        name, [&] { return py::cast(value); },
        [&](const py::object& given) { value = given.cast<T>(); });
  }
  void operator()(const char* name, std::optional<Vec3d>& value);
  void operator()(const char* name, Vec3d& value);
  /// A choice by its name.
  template <class E>
  requires std::is_enum_v<E>
  void operator()(const char* name, E& value, const Choices<E>& choices) {
    visit(
        name, [&] { return name_of(std::optional<E>(value), choices); },
        [&](const py::object& given) { value = *chosen(name, given, choices); });
  }
  /// A choice that may be left open: None.
  template <class E>
  void operator()(const char* name, std::optional<E>& value, const Choices<E>& choices) {
    visit(
        name, [&] { return name_of(value, choices); },
        [&](const py::object& given) {
          value = given.is_none() ? std::nullopt : chosen(name, given, choices);
        });
  }

  /// Throws Error(kUsage) where one of the names has another value than its default although
  /// nothing heeds it; `where` says why: "without `clip`".
  void refuse(bool unheeded, const std::vector<const char*>& names, const std::string& where) const;

  /// The names with their values, of a visit that lists.
  const py::dict& listed() const { return listed_; }

 private:
  void visit(const char* name, const std::function<py::object()>& get,
             const std::function<void(const py::object&)>& set);
  [[noreturn]] static void refuse_choice(const char* name, const py::object& given,
                                         const std::string& known);

  template <class E>
  static py::object name_of(const std::optional<E>& value, const Choices<E>& choices) {
    for (const auto& [text, choice] : choices) {
      if (value == choice) return py::str(text);
    }
    return py::none();
  }
  template <class E>
  static std::optional<E> chosen(const char* name, const py::object& given,
                                 const Choices<E>& choices) {
    std::string known;
    for (const auto& [text, choice] : choices) {
      if (py::isinstance<py::str>(given) && given.cast<std::string>() == text) return choice;
      known += (known.empty() ? "" : ", ") + std::string(text);
    }
    refuse_choice(name, given, known);
  }

  py::dict given_;
  py::dict listed_;
  bool takes_ = false;
  std::vector<std::string> changed_;  ///< Names whose values are others than the defaults.
};

/// The options of a struct with their defaults.
/// \param visit  visits the members.
template <class T>
py::dict defaults(void (*visit)(Options&, T&)) {
  T arguments{};
  Options list;
  visit(list, arguments);
  return list.listed();
}

/// Calls the library with names of its fields for names of arguments: where both differ, usage
/// errors name the argument.
void with_names(const std::vector<std::pair<std::string, std::string>>& names,
                const std::function<void()>& work);

/// numpy.asarray().
py::array as_array(const py::object& given);

/// Values of an array as C order of a type, in memory of its own. Floating-point types take any
/// real numbers, integers only whole numbers that fit. `name` is the argument's, for messages.
/// \param shape  -1 for any number; its rest must match.
py::array values_of(const py::object& given, const py::dtype& type,
                    const std::vector<py::ssize_t>& shape, const std::string& name);

/// A text with the names of files, as os.fsdecode() has them: their bytes may be no UTF-8.
py::str text_of(const std::string& text);
/// A type as messages have it: "float32".
std::string text_of(const py::dtype& type);
/// A shape as messages have it: "(N, 3)", N for -1.
std::string shape_text(const std::vector<py::ssize_t>& shape);

/// The object for work of the library: views may have left it in a state that no reader leaves.
/// Throws Error(kInput) where the library could not work on it.
SurfelCloud& ready(HeldCloud& held);
TriangleMesh& ready(HeldMesh& held);
GaussianCloud& ready(HeldGaussians& held);

/// Values of colours, linear: 8 and 16 bits of unsigned integers are sRGB codes, and are decoded.
py::array linear_colors(const py::object& given, const std::vector<py::ssize_t>& shape,
                        const std::string& name);

void bind_surfels(py::module_& module);
void bind_meshes(py::module_& module);
void bind_gaussians(py::module_& module);
void bind_files(py::module_& module);
void bind_pictures(py::module_& module);
void bind_work(py::module_& module);

}  // namespace surfel::python
