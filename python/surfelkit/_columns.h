#pragma once

// Columns: arrays of an object of the library that NumPy sees in their place.

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#include "_core.h"

namespace surfel::python {

using Shape = std::vector<py::ssize_t>;

/// The scalar type and the shape of an array's element.
template <class T>
struct Element {
  using Scalar = T;
  static Shape shape() { return {}; }
};
template <int N>
struct Element<Eigen::Matrix<float, N, 1>> {
  using Scalar = float;
  static Shape shape() { return {N}; }
};
template <class T, std::size_t N>
struct Element<std::array<T, N>> {
  using Scalar = typename Element<T>::Scalar;
  static Shape shape() {
    Shape inner = Element<T>::shape();
    inner.insert(inner.begin(), static_cast<py::ssize_t>(N));
    return inner;
  }
};

/// A column of an object: an array with an element a row.
template <class Owner>
struct Column {
  const char* attribute;
  std::vector<const char*> names;  ///< The columns of a file that it holds, one after another.
  const char* about;
  py::dtype type;
  Shape shape;        ///< Of a row.
  std::size_t bytes;  ///< Of a row.
  void* (*data)(Owner&);
  std::size_t (*rows)(const Owner&);
  void (*resize)(Owner&, std::size_t rows);
  std::shared_ptr<void> (*taken)(Owner&);  ///< Leaves the column empty.

  /// The shape of an array of all rows; -1: of any number.
  Shape shape_of(py::ssize_t count) const {
    Shape all = shape;
    all.insert(all.begin(), count);
    return all;
  }
};

template <class Owner, auto Member>
Column<Owner> column(const char* attribute, const char* about,
                     std::vector<const char*> names = {}) {
  using Values = std::remove_reference_t<decltype(std::declval<Owner&>().*Member)>;
  using T = typename Values::value_type;
  return {attribute,
          std::move(names),
          about,
          py::dtype::of<typename Element<T>::Scalar>(),
          Element<T>::shape(),
          sizeof(T),
          [](Owner& o) -> void* { return (o.*Member).data(); },
          [](const Owner& o) { return (o.*Member).size(); },
          [](Owner& o, std::size_t rows) { (o.*Member).resize(rows); },
          [](Owner& o) -> std::shared_ptr<void> {
            auto old = std::make_shared<Values>(std::move(o.*Member));
            (o.*Member).clear();
            return old;
          }};
}

/// A column as NumPy sees it, in its place.
template <class T>
py::object view_of(const std::shared_ptr<Held<T>>& held, const Column<T>& column, bool required) {
  const std::size_t rows = column.rows(held->value);
  if (rows == 0 && !required) return py::none();
  const Shape shape = column.shape_of(static_cast<py::ssize_t>(rows));
  if (rows == 0) return py::array(column.type, shape);
  return py::array(column.type, shape, column.data(held->value), py::cast(held));
}

/// Gives a column values in its place, or makes it.
template <class T>
void assign(Held<T>& held, const Column<T>& column, const py::array& values, std::size_t rows,
            const char* what) {
  const auto given = static_cast<std::size_t>(values.shape(0));
  if (given != rows) {
    throw_input("", "`" + std::string(column.attribute) + "` has " + std::to_string(given) +
                        " rows; there are " + std::to_string(rows) + " " + what);
  }
  if (column.rows(held.value) != rows) {
    require_unused(held);
    column.resize(held.value, rows);
  }
  if (rows > 0) std::memcpy(column.data(held.value), values.data(), rows * column.bytes);
}

template <class T>
void take_away(Held<T>& held, const Column<T>& column) {
  if (column.rows(held.value) == 0) return;
  require_unused(held);
  held.retired.push_back(column.taken(held.value));
}

inline bool is_color(const std::string& attribute) {
  return attribute == "colors" || attribute == "vertex_colors";
}

template <class T>
py::array converted(const Column<T>& column, const py::object& given) {
  const Shape shape = column.shape_of(-1);
  return is_color(column.attribute) ? linear_colors(given, shape, column.attribute)
                                    : values_of(given, column.type, shape, column.attribute);
}

/// Positions of a cloud without other columns may become any number.
template <class T>
void set_positions(Held<T>& held, const std::vector<Column<T>>& columns, const py::array& values) {
  const auto rows = static_cast<std::size_t>(values.shape(0));
  if (rows != held.value.size()) {
    for (std::size_t i = 1; i < columns.size(); ++i) {
      if (columns[i].rows(held.value) == 0) continue;
      throw_input("", "`positions` has " + std::to_string(rows) + " rows; the cloud has " +
                          std::to_string(held.value.size()) +
                          " and other columns as well; make a new one of arrays");
    }
    take_away(held, columns.front());
  }
  assign(held, columns.front(), values, rows, "surfels");
}

/// Positions as they are, or, of double precision and far from the origin, relative to another
/// origin.
template <class T>
void place(Held<T>& held, const std::vector<Column<T>>& columns, const py::object& given) {
  const py::array array = py::module_::import("numpy").attr("asarray")(given);
  if (array.dtype().kind() != 'f' || array.itemsize() <= 4) {
    set_positions(held, columns, converted(columns.front(), given));
    return;
  }
  const py::array values = values_of(given, py::dtype::of<double>(), {-1, 3}, "positions");
  const auto* const from = static_cast<const double*>(values.data());
  const auto rows = static_cast<std::size_t>(values.shape(0));
  Bounds box;
  for (std::size_t i = 0; i < rows; ++i) {
    const Vec3d p(from + 3 * i);
    if (p.allFinite()) box.add(p);
  }
  held.value.origin = box.empty() ? Vec3d(0, 0, 0) : float_origin(box);
  held.value.position.resize(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    held.value.position[i] = (Vec3d(from + 3 * i) - held.value.origin).template cast<float>();
  }
}

/// Rows that a slice, a mask or indices choose, as NumPy has it.
Array<std::uint32_t> rows_chosen(const py::object& key, std::size_t rows);

/// A vector as Python has it, or None.
py::object tuple_of(const std::optional<Vec3d>& v);

/// "<SurfelCloud of 3 surfels: positions, normals>".
template <class T>
std::string description(const char* type, std::size_t rows, const char* what, const T& value,
                        const std::vector<Column<T>>& columns) {
  std::string found;
  for (const Column<T>& column : columns) {
    if (column.rows(value) == 0) continue;
    found += (found.empty() ? "" : ", ") + std::string(column.attribute);
  }
  return "<" + std::string(type) + " of " + std::to_string(rows) + " " + what + ": " + found + ">";
}

/// Properties for the columns of a class: views in their place, and assignments by copying.
/// \param required  so many of the first columns are always there.
/// \param viewed    called before a view of a column is given out.
template <class T, class Set, class Viewed>
void bind_columns(py::class_<Held<T>, std::shared_ptr<Held<T>>>& bound,
                  const std::vector<Column<T>>& columns, std::size_t required, const Set& set,
                  const Viewed& viewed) {
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const Column<T>& column = columns[i];
    const bool always = i < required;
    std::string about = text_of(column.type) + " " + shape_text(column.shape_of(-1)) + ". " +
                        column.about + (always ? "" : " None: there are none.");
    bound.def_property(column.attribute,
                       py::cpp_function(
                           [&column, always, viewed](const std::shared_ptr<Held<T>>& self) {
                             viewed(*self, column);
                             return view_of(self, column, always);
                           },
                           py::doc(about.c_str())),
                       py::cpp_function([&column, set](Held<T>& self, const py::object& given) {
                         set(self, column, given);
                       }));
  }
}

}  // namespace surfel::python
