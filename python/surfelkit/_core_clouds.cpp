// Surfels, meshes and Gaussians, whose arrays NumPy sees in their place; their files.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string_view>

#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/mesh_io.h>

#include "_core.h"

namespace surfel::python {
namespace {

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

/// The columns of docs/format.md, but for `radius`, which follows from the variances.
const std::vector<Column<SurfelCloud>>& surfel_columns() {
  using C = SurfelCloud;
  static const auto* const all = new std::vector<Column<C>>{
      column<C, &C::position>("positions", "Positions relative to `origin`, scene units.",
                              {"x", "y", "z"}),
      column<C, &C::normal>("normals", "Unit normals; all zero: unknown.", {"nx", "ny", "nz"}),
      column<C, &C::shading_normal>(
          "shading_normals",
          "Mean normals under the surfels, for shading; their length, 1 at most, tells how much "
          "they vary; all zero: as `normals`.",
          {"shading_nx", "shading_ny", "shading_nz"}),
      column<C, &C::variance>("variance", "Variance of round Gaussians, units^2.", {"variance"}),
      column<C, &C::tangent>(
          "tangents", "Unit tangents of elliptic Gaussians, with `variance_u` and `variance_v`.",
          {"tx", "ty", "tz"}),
      column<C, &C::variance_u>("variance_u", "Variance along the tangent, units^2.",
                                {"variance_u"}),
      column<C, &C::variance_v>("variance_v", "Variance across the tangent, units^2.",
                                {"variance_v"}),
      column<C, &C::area>("area", "Surface that each surfel stands for, units^2.", {"area"}),
      column<C, &C::clip1>("clip1", "Unit directions in which surfels are cut; zero: not cut.",
                           {"clip1_x", "clip1_y", "clip1_z"}),
      column<C, &C::clip1_distance>(
          "clip1_distance", "How far from the centres `clip1` cuts, scene units.", {"clip1_d"}),
      column<C, &C::clip2>("clip2", "As `clip1`: what both leave is the surfel.",
                           {"clip2_x", "clip2_y", "clip2_z"}),
      column<C, &C::clip2_distance>("clip2_distance", "As `clip1_distance`, of `clip2`.",
                                    {"clip2_d"}),
      column<C, &C::color>("colors",
                           "Colours R G B, linear light. Arrays of uint8 and uint16 that are "
                           "assigned are sRGB codes, and are decoded.",
                           {"red", "green", "blue"}),
      column<C, &C::alpha>("alpha", "Opacities, 0 to 1, straight.", {"alpha"}),
      column<C, &C::coefficient>(
          "coefficients", "Texture coefficients R G B, linear light; drawn instead of `colors`.",
          {"w_red", "w_green", "w_blue"}),
      column<C, &C::uv>("uv", "Texture coordinates; v = 0 is the bottom row of the image.",
                        {"u", "v"}),
      column<C, &C::dpdu>("dpdu", "Derivatives of the surface by u, units by image width.",
                          {"dpdu_x", "dpdu_y", "dpdu_z"}),
      column<C, &C::dpdv>("dpdv", "Derivatives of the surface by v, units by image height.",
                          {"dpdv_x", "dpdv_y", "dpdv_z"}),
      column<C, &C::material>("material", "Rows of the scene file's table of materials.",
                              {"material"}),
      column<C, &C::group>("group", "Groups of surfel-group.", {"group"}),
      column<C, &C::group_radius>("group_radius", "Radii in the groups, scene units.",
                                  {"group_radius"}),
      column<C, &C::source>("source", "Copies of one surfel share it.", {"source"}),
      column<C, &C::level>("level", "Level of detail, 0 the finest.", {"level"})};
  return *all;
}

const std::vector<Column<TriangleMesh>>& mesh_columns() {
  using M = TriangleMesh;
  static const auto* const all = new std::vector<Column<M>>{
      column<M, &M::position>("vertices", "Places of the vertices relative to `origin`, units."),
      column<M, &M::face>("triangles",
                          "Vertices of the triangles, counter-clockwise from outside."),
      column<M, &M::color>(
          "vertex_colors",
          "Colours of the vertices, linear light; assigned as SurfelCloud.colors."),
      column<M, &M::wedge_uv>("triangle_uvs",
                              "Texture coordinates of the corners; v = 0 is the bottom row."),
      column<M, &M::wedge_normal>("triangle_normals", "Unit normals of the corners."),
      column<M, &M::face_material>("triangle_material_ids", "Rows of `materials`.")};
  return *all;
}

const std::vector<Column<GaussianCloud>>& gaussian_columns() {
  using G = GaussianCloud;
  static const auto* const all = new std::vector<Column<G>>{
      column<G, &G::position>("positions", "Centres relative to `origin`, scene units."),
      column<G, &G::scale>("scales", "Standard deviations along the axes, scene units."),
      column<G, &G::rotation>("rotations", "Unit quaternions w, x, y, z of the axes."),
      column<G, &G::amplitude>("opacities",
                               "Opacities, 0 to 1; densities, by unit of length, of volumes.")};
  return *all;
}

std::size_t rows_of(const TriangleMesh& mesh, const std::string& attribute) {
  return attribute == "vertex_colors" ? mesh.position.size() : mesh.face.size();
}

std::size_t hash_of(const SurfelCloud& cloud) {
  return std::hash<std::string_view>()(
      {reinterpret_cast<const char*>(cloud.position.data()), cloud.size() * sizeof(Vec3f)});
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

bool is_color(const std::string& attribute) {
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

void set_column(HeldCloud& held, const Column<SurfelCloud>& column, const py::object& given) {
  const std::string attribute = column.attribute;
  if (given.is_none()) {
    if (attribute == "positions") throw_input("", "`positions` cannot be taken away");
    take_away(held, column);
    return;
  }
  const py::array values = converted(column, given);
  SurfelCloud& cloud = held.value;
  if (attribute == "positions") {
    const bool same = static_cast<std::size_t>(values.shape(0)) == cloud.size();
    if (!same && !cloud.extra.empty()) {
      throw_input("",
                  "`positions` has another number of rows than the cloud, which has other "
                  "columns as well; make a new one of arrays");
    }
    set_positions(held, surfel_columns(), values);
    cloud.decimals.reset();
    cloud.las.reset();
    return;
  }
  if (attribute == "colors") {
    const char kind = py::array(py::module_::import("numpy").attr("asarray")(given)).dtype().kind();
    const auto size = py::array(py::module_::import("numpy").attr("asarray")(given)).itemsize();
    cloud.color_encoding = kind != 'u' ? ColorEncoding::kFloatLinear
                           : size == 1 ? ColorEncoding::kUint8Srgb
                                       : ColorEncoding::kUint16Srgb;
  }
  assign(held, column, values, cloud.size(), "surfels");
}

// Columns by the names of files.

ScalarType scalar_type(const py::dtype& type) {
  for (const ScalarType one :
       {ScalarType::kInt8, ScalarType::kUint8, ScalarType::kInt16, ScalarType::kUint16,
        ScalarType::kInt32, ScalarType::kUint32, ScalarType::kFloat32, ScalarType::kFloat64}) {
    const py::dtype known = visit_type(one, []<class T>(T) { return py::dtype::of<T>(); });
    if (known.is(type) || known.equal(type)) return one;
  }
  throw_input("",
              "columns have the types int8 to int32, uint8 to uint32, float32 and float64, not " +
                  text_of(type));
}

/// A place of a known column: which, and which component.
struct Place {
  const Column<SurfelCloud>* column;
  std::size_t component;
};

std::optional<Place> place_of(const std::string& name) {
  for (const Column<SurfelCloud>& column : surfel_columns()) {
    for (std::size_t i = 0; i < column.names.size(); ++i) {
      if (name == column.names[i]) return Place{&column, i};
    }
  }
  return std::nullopt;
}

auto find_extra(SurfelCloud& cloud, const std::string& name) {
  return std::find_if(cloud.extra.begin(), cloud.extra.end(),
                      [&](const ExtraProperty& p) { return p.name == name; });
}

void note_positions(HeldCloud& held) {
  if (!held.positions_seen && (held.value.decimals || held.value.las)) {
    held.positions_seen = hash_of(held.value);
  }
}

std::vector<std::string> column_names(const HeldCloud& held) {
  std::vector<std::string> names;
  for (const Column<SurfelCloud>& column : surfel_columns()) {
    if (column.rows(held.value) == 0 && &column != &surfel_columns().front()) continue;
    names.insert(names.end(), column.names.begin(), column.names.end());
  }
  for (const ExtraProperty& property : held.value.extra) names.push_back(property.name);
  return names;
}

py::object named_column(const std::shared_ptr<HeldCloud>& held, const std::string& name) {
  SurfelCloud& cloud = held->value;
  const auto rows = static_cast<py::ssize_t>(cloud.size());
  if (const std::optional<Place> place = place_of(name)) {
    const Column<SurfelCloud>& column = *place->column;
    if (column.rows(cloud) == 0 && &column != &surfel_columns().front()) throw py::key_error(name);
    if (rows == 0) return py::array(column.type, Shape{0});
    if (&column == &surfel_columns().front()) note_positions(*held);
    const auto step = static_cast<std::size_t>(column.type.itemsize());
    return py::array(column.type, Shape{rows}, Shape{static_cast<py::ssize_t>(column.bytes)},
                     static_cast<std::byte*>(column.data(cloud)) + place->component * step,
                     py::cast(held));
  }
  const auto extra = find_extra(cloud, name);
  if (extra == cloud.extra.end()) throw py::key_error(name);
  const py::dtype type = visit_type(extra->type, []<class T>(T) { return py::dtype::of<T>(); });
  if (rows == 0) return py::array(type, Shape{0});
  return py::array(type, Shape{rows}, extra->data.data(), py::cast(held));
}

void check_name(const std::string& name) {
  const bool fine = !name.empty() && std::all_of(name.begin(), name.end(),
                                                 [](char c) { return c > ' ' && c < 127; });
  if (!fine || name == "radius") {
    throw_input("", "'" + name + "' cannot be the name of a column: " +
                        (fine ? "it follows from the variances"
                              : "files have names of ASCII letters, digits and signs alone"));
  }
}

void set_named_column(const std::shared_ptr<HeldCloud>& held, const std::string& name,
                      const py::object& given) {
  SurfelCloud& cloud = held->value;
  if (const std::optional<Place> place = place_of(name)) {
    const Column<SurfelCloud>& column = *place->column;
    if (column.shape.empty()) return set_column(*held, column, given);
    if (column.rows(cloud) == 0) {
      throw_input(
          "", "there is no column " + name + "; assign `" + column.attribute + "`, which has it");
    }
    const py::array values = values_of(given, column.type, {-1}, name);
    named_column(held, name).attr("__setitem__")(py::ellipsis(), values);
    return;
  }
  check_name(name);
  const py::array array = py::module_::import("numpy").attr("asarray")(given);
  const ScalarType type = scalar_type(array.dtype());
  const py::array values = values_of(array, array.dtype(), {-1}, name);
  if (static_cast<std::size_t>(values.shape(0)) != cloud.size()) {
    throw_input("", "column " + name + " has " + std::to_string(values.shape(0)) +
                        " rows; there are " + std::to_string(cloud.size()) + " surfels");
  }
  const std::size_t bytes = cloud.size() * scalar_size(type);
  auto extra = find_extra(cloud, name);
  if (extra == cloud.extra.end() || extra->type != type) {
    require_unused(*held);
    if (extra == cloud.extra.end()) {
      cloud.extra.push_back({name, type, {}});
      extra = cloud.extra.end() - 1;
    } else {
      held->retired.push_back(std::make_shared<Array<std::byte>>(std::move(extra->data)));
      *extra = {name, type, {}};
    }
    extra->data.resize(bytes);
  }
  if (bytes > 0) std::memcpy(extra->data.data(), values.data(), bytes);
}

void remove_named_column(HeldCloud& held, const std::string& name) {
  if (const std::optional<Place> place = place_of(name)) {
    if (place->column->rows(held.value) == 0) throw py::key_error(name);
    if (!place->column->shape.empty()) {
      throw_input("", "column " + name + " is a part of `" + place->column->attribute +
                          "`; assign None to that");
    }
    take_away(held, *place->column);
    return;
  }
  const auto extra = find_extra(held.value, name);
  if (extra == held.value.extra.end()) throw py::key_error(name);
  require_unused(held);
  held.retired.push_back(std::make_shared<Array<std::byte>>(std::move(extra->data)));
  held.value.extra.erase(extra);
}

// Clouds of arrays, and parts of clouds.

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

void make_unit(Array<Vec3f>& normals) {
  for (Vec3f& normal : normals) {
    const Vec3d wide = normal.cast<double>();
    const double length = wide.norm();
    const bool known = length > 0 && std::isfinite(length);
    normal = known ? Vec3f((wide / length).cast<float>()) : Vec3f(0, 0, 0);
  }
}

/// Variances of discs of these radii, as files have them: radius^2 / 2.
void set_radii(HeldCloud& held, const py::object& given) {
  const py::array values = values_of(given, py::dtype::of<double>(), {-1}, "radii");
  const auto* const radii = static_cast<const double*>(values.data());
  const auto rows = static_cast<std::size_t>(values.shape(0));
  if (rows != held.value.size()) {
    throw_input("", "`radii` has " + std::to_string(rows) + " rows; there are " +
                        std::to_string(held.value.size()) + " surfels");
  }
  for (std::size_t i = 0; i < rows; ++i) {
    if (std::isfinite(radii[i]) && radii[i] > 0) continue;
    throw_input("", "`radii` of surfel " + std::to_string(i) + " is " + std::to_string(radii[i]) +
                        "; radii must be finite and above 0");
  }
  held.value.variance.resize(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    held.value.variance[i] = static_cast<float>(radii[i] * radii[i] / 2);
  }
}

const Column<SurfelCloud>& surfel_column(const std::string& attribute) {
  const auto& all = surfel_columns();
  return *std::find_if(all.begin(), all.end(),
                       [&](const auto& column) { return attribute == column.attribute; });
}

std::shared_ptr<HeldCloud> cloud_from_arrays(const py::object& positions, const py::object& normals,
                                             const py::object& colors, const py::object& radii,
                                             const py::object& alpha,
                                             const std::optional<py::dict>& columns) {
  auto held = hold(SurfelCloud());
  place(*held, surfel_columns(), positions);
  if (!normals.is_none()) {
    set_column(*held, surfel_column("normals"), normals);
    make_unit(held->value.normal);
  }
  set_column(*held, surfel_column("colors"), colors);
  set_column(*held, surfel_column("alpha"), alpha);
  if (!radii.is_none()) set_radii(*held, radii);
  if (columns) {
    for (const auto& [name, values] : *columns) {
      set_named_column(held, name.cast<std::string>(), values.template cast<py::object>());
    }
  }
  return held;
}

/// Rows that a slice, a mask or indices choose, as NumPy has it.
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

std::string list_of(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

template <class T>
std::string description(const char* type, std::size_t rows, const char* what, const T& value,
                        const std::vector<Column<T>>& columns) {
  std::vector<std::string> found;
  for (const Column<T>& column : columns) {
    if (column.rows(value) > 0) found.emplace_back(column.attribute);
  }
  return "<" + std::string(type) + " of " + std::to_string(rows) + " " + what + ": " +
         list_of(found) + ">";
}

py::object tuple_of(const std::optional<Vec3d>& v) {
  if (!v) return py::none();
  return py::make_tuple(v->x(), v->y(), v->z());
}
std::optional<Vec3d> vector_of(const std::optional<std::array<double, 3>>& v) {
  return v ? std::optional(Vec3d(v->data())) : std::nullopt;
}

const Choices<ColorLight>& color_lights() {
  static const Choices<ColorLight> all{{"recorded", ColorLight::kRecorded},
                                       {"reflectance", ColorLight::kReflectance},
                                       {"mixed", ColorLight::kMixed}};
  return all;
}

/// Properties for the columns of a class: views in their place, and assignments by copying.
template <class T, class Set>
void bind_columns(py::class_<Held<T>, std::shared_ptr<Held<T>>>& bound,
                  const std::vector<Column<T>>& columns, std::size_t required, const Set& set) {
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const Column<T>& column = columns[i];
    const bool always = i < required;
    std::string about = text_of(column.type) + " " + shape_text(column.shape_of(-1)) + ". " +
                        column.about + (always ? "" : " None: there are none.");
    bound.def_property(column.attribute,
                       py::cpp_function(
                           [&column, always](const std::shared_ptr<Held<T>>& self) {
                             if constexpr (std::is_same_v<T, SurfelCloud>) {
                               if (&column == &surfel_columns().front()) note_positions(*self);
                             }
                             return view_of(self, column, always);
                           },
                           py::doc(about.c_str())),
                       py::cpp_function([&column, set](Held<T>& self, const py::object& given) {
                         set(self, column, given);
                       }));
  }
}

void bind_surfels(py::module_& module) {
  using Class = py::class_<HeldCloud, std::shared_ptr<HeldCloud>>;
  Class bound(module, "SurfelCloud",
              "Surfels or points: a structure of arrays, one row each.\n\n"
              "Attributes are NumPy views of the cloud's own memory, so that writing to them\n"
              "changes the cloud, and they outlive it; those that the cloud lacks are None.\n"
              "Assigning to an attribute copies values in their place, or adds the column.\n"
              "`columns` has every number by the name that files have.");
  bound.def(py::init([] { return hold(SurfelCloud()); }));
  bound.def_static(
      "from_arrays", &cloud_from_arrays, py::arg("positions"), py::kw_only(),
      py::arg("normals") = py::none(), py::arg("colors") = py::none(),
      py::arg("radii") = py::none(), py::arg("alpha") = py::none(), py::arg("columns") = py::none(),
      "A cloud of arrays, which are copied.\n\n"
      "positions: (N, 3), scene units. Of float64 far from the origin `origin` becomes their\n"
      "    middle, so that single precision tells them apart. NaN are kept: estimate() leaves\n"
      "    them out, and they are not drawn.\n"
      "normals: (N, 3) of any length; zero or not finite: unknown.\n"
      "colors: (N, 3); floats are linear light, uint8 and uint16 sRGB codes.\n"
      "radii: (N,), scene units, above 0: discs; their variance is radius^2 / 2.\n"
      "alpha: (N,), 0 to 1.\n"
      "columns: further columns by the names of files.\n\n"
      "Raises InputError for other shapes and types.");
  bind_columns(bound, surfel_columns(), 1, &set_column);
  bound.def("__len__", [](const HeldCloud& self) { return self.value.size(); });
  bound.def("__repr__", [](const HeldCloud& self) {
    return description("SurfelCloud", self.value.size(), "surfels", self.value, surfel_columns());
  });
  bound.def(
      "__getitem__",
      [](HeldCloud& self, const py::object& key) {
        SurfelCloud& cloud = ready(self);
        const Array<std::uint32_t> rows = rows_chosen(key, cloud.size());
        const InUse use(self);
        return hold(made([&] { return cloud.gathered(rows); }));
      },
      py::arg("key"), "A new cloud of the rows that a slice, a mask or indices choose.");
  bound.def(
      "copy", [](HeldCloud& self) { return hold(SurfelCloud(ready(self))); },
      "A cloud of its own with the same values.");
  bound.def(
      "bounds",
      [](HeldCloud& self) {
        const InUse use(self);
        const Bounds box = made([&] { return self.value.bounds(); });
        if (box.empty()) throw_input("", "the cloud has no finite position");
        return py::make_tuple(tuple_of(box.min), tuple_of(box.max));
      },
      "Lowest and highest corner of the box around the finite positions, world coordinates.");
  bound.def(
      "world_positions",
      [](const HeldCloud& self) {
        const auto rows = static_cast<py::ssize_t>(self.value.size());
        py::array_t<double> out(Shape{rows, 3});
        double* to = out.mutable_data();
        for (std::size_t i = 0; i < self.value.size(); ++i, to += 3) {
          const Vec3d world = self.value.world(i);
          std::copy_n(world.data(), 3, to);
        }
        return out;
      },
      "float64 (N, 3), a copy: origin + positions.");
  bound.def_property_readonly(
      "origin", [](const HeldCloud& self) { return tuple_of(self.value.origin); },
      "World coordinates that `positions` are relative to: zero unless the scene lies far away.");
  bound.def_property(
      "up", [](const HeldCloud& self) { return tuple_of(self.value.up); },
      [](HeldCloud& self, const std::optional<std::array<double, 3>>& up) {
        self.value.up = vector_of(up);
      },
      "Upward direction, or None where nobody has said it.");
  bound.def_property(
      "viewpoint",
      [](const HeldCloud& self) {
        const auto& v = self.value.viewpoint;
        return tuple_of(v ? std::optional(v->position) : std::nullopt);
      },
      [](HeldCloud& self, const std::optional<std::array<double, 3>>& place) {
        self.value.viewpoint.reset();
        if (place) self.value.viewpoint = Viewpoint{Vec3d(place->data())};
      },
      "Where the sensor of a scan stood, world coordinates, or None.");
  bound.def_property(
      "color_light",
      [](const HeldCloud& self) -> std::optional<std::string> {
        for (const auto& [name, light] : color_lights()) {
          if (light == self.value.color_light) return name;
        }
        return std::nullopt;
      },
      [](HeldCloud& self, const std::optional<std::string>& given) {
        std::string known;
        for (const auto& [name, light] : color_lights()) {
          if (given == name) {
            self.value.color_light = light;
            return;
          }
          known += std::string(name) + ", ";
        }
        if (given)
          throw_usage("`color_light` is '" + *given + "'; it must be " + known + "or None");
        self.value.color_light = ColorLight::kUnsaid;
      },
      "What the colours are: 'recorded' light, which is shown as it is, the surface's own\n"
      "'reflectance', which is lit, or 'mixed'; None: nobody has said, taken for recorded.");
  bound.def_property(
      "provenance", [](const HeldCloud& self) { return self.value.provenance; },
      [](HeldCloud& self, std::vector<std::string> lines) {
        self.value.provenance = std::move(lines);
      },
      "Lines that tell how the cloud was made; a list of its own.");
  bound.def_property(
      "comments", [](const HeldCloud& self) { return self.value.comments; },
      [](HeldCloud& self, std::vector<std::string> lines) {
        self.value.comments = std::move(lines);
      },
      "Other comments of the file; a list of its own.");
  bound.def("_column_names", &column_names);
  bound.def("_column", &named_column);
  bound.def("_set_column", &set_named_column);
  bound.def("_remove_column", &remove_named_column);
}

void set_mesh_column(HeldMesh& held, const Column<TriangleMesh>& column, const py::object& given) {
  const std::string attribute = column.attribute;
  const bool required = attribute == "vertices" || attribute == "triangles";
  if (given.is_none()) {
    if (required) throw_input("", "`" + attribute + "` cannot be taken away");
    take_away(held, column);
    return;
  }
  const py::array values = converted(column, given);
  const auto rows = static_cast<std::size_t>(values.shape(0));
  if (required && rows != column.rows(held.value)) {
    throw_input("", "`" + attribute + "` has " + std::to_string(rows) + " rows; the mesh has " +
                        std::to_string(column.rows(held.value)) + "; make a new one of arrays");
  }
  assign(held, column, values, required ? rows : rows_of(held.value, attribute),
         attribute == "vertices" || attribute == "vertex_colors" ? "vertices" : "triangles");
}

void bind_meshes(py::module_& module) {
  using Class = py::class_<HeldMesh, std::shared_ptr<HeldMesh>>;
  Class bound(module, "TriangleMesh",
              "Triangles. Attributes are NumPy views as those of SurfelCloud.");
  bound.def_static(
      "from_arrays",
      [](const py::object& vertices, const py::object& triangles, const py::object& colors,
         const py::object& uvs) {
        auto held = hold(TriangleMesh());
        const auto& columns = mesh_columns();
        const auto take = [&](const Column<TriangleMesh>& column, const py::object& given) {
          const py::array values = converted(column, given);
          assign(*held, column, values, static_cast<std::size_t>(values.shape(0)), "");
        };
        take(columns[0], vertices);
        take(columns[1], triangles);
        set_mesh_column(*held, columns[2], colors);
        set_mesh_column(*held, columns[3], uvs);
        ready(*held);
        return held;
      },
      py::arg("vertices"), py::arg("triangles"), py::kw_only(),
      py::arg("vertex_colors") = py::none(), py::arg("triangle_uvs") = py::none(),
      "A mesh of arrays, which are copied: (V, 3) floats, (T, 3) integers, (V, 3) colours as\n"
      "SurfelCloud.colors takes them, (T, 3, 2) texture coordinates of the corners.\n\n"
      "Raises InputError for other shapes and types, coordinates that are not finite, and\n"
      "triangles that name vertices which are not there.");
  bind_columns(bound, mesh_columns(), 2, &set_mesh_column);
  bound.def("__repr__", [](const HeldMesh& self) {
    return description("TriangleMesh", self.value.face.size(), "triangles", self.value,
                       mesh_columns());
  });
  bound.def_property_readonly(
      "origin", [](const HeldMesh& self) { return tuple_of(self.value.origin); },
      "World coordinates that `vertices` are relative to.");
  bound.def_property_readonly(
      "up", [](const HeldMesh& self) { return tuple_of(self.value.up); },
      "Upward direction, or None where the file does not say it.");
  bound.def_property_readonly(
      "materials",
      [](const HeldMesh& self) {
        py::list all;
        for (const MeshMaterial& m : self.value.material) {
          py::dict one;
          one["name"] = m.name;
          one["diffuse"] = py::make_tuple(m.diffuse.x(), m.diffuse.y(), m.diffuse.z());
          one["texture"] = m.texture;
          all.append(one);
        }
        return all;
      },
      "A dict for each material: name, diffuse (linear R G B), texture (a file, or empty).");
  bound.def_property_readonly(
      "notes", [](const HeldMesh& self) { return self.value.notes; },
      "What the file holds or names that was not taken into account.");
}

std::size_t stride_of(const GaussianCloud& cloud) { return cloud.harmonics_stride(); }

std::shared_ptr<HeldGaussians> gaussians_from_arrays(const py::object& positions,
                                                     const py::object& scales,
                                                     const py::object& rotations,
                                                     const py::object& opacities,
                                                     const py::object& harmonics) {
  auto held = hold(GaussianCloud());
  GaussianCloud& cloud = held->value;
  place(*held, gaussian_columns(), positions);
  const py::object given[] = {scales, rotations, opacities};
  for (std::size_t i = 0; i < 3; ++i) {
    const Column<GaussianCloud>& column = gaussian_columns()[i + 1];
    assign(*held, column, converted(column, given[i]), cloud.size(), "Gaussians");
  }
  const py::array values = values_of(harmonics, py::dtype::of<float>(), {-1, -1, 3}, "harmonics");
  while (cloud.degree < GaussianCloud::kMostDegree &&
         static_cast<py::ssize_t>(stride_of(cloud)) < 3 * values.shape(1)) {
    ++cloud.degree;
  }
  if (static_cast<std::size_t>(values.shape(0)) != cloud.size() ||
      static_cast<py::ssize_t>(stride_of(cloud)) != 3 * values.shape(1)) {
    throw_input("", "`harmonics` has the shape " +
                        shape_text({values.shape(0), values.shape(1), values.shape(2)}) +
                        "; it must be (" + std::to_string(cloud.size()) +
                        ", 1, 4, 9, 16 or 25, 3)");
  }
  cloud.harmonics.resize(static_cast<std::size_t>(values.size()));
  if (values.size() > 0) {
    std::memcpy(cloud.harmonics.data(), values.data(), cloud.harmonics.size() * sizeof(float));
  }
  return held;
}

void set_gaussian_column(HeldGaussians& held, const Column<GaussianCloud>& column,
                         const py::object& given) {
  assign(held, column, converted(column, given), held.value.size(), "Gaussians");
}

void bind_gaussians(py::module_& module) {
  using Class = py::class_<HeldGaussians, std::shared_ptr<HeldGaussians>>;
  Class bound(module, "GaussianCloud",
              "Gaussians in space, such as trained splats. Attributes are NumPy views as those of\n"
              "SurfelCloud; their number is fixed.");
  bound.def_static(
      "from_arrays", &gaussians_from_arrays, py::arg("positions"), py::arg("scales"),
      py::arg("rotations"), py::arg("opacities"), py::arg("harmonics"),
      "Gaussians of arrays, which are copied: (N, 3), (N, 3), (N, 4), (N,), (N, K, 3) with\n"
      "K = (degree + 1)^2, values as the attributes of the same names have them.\n\n"
      "Raises InputError for other shapes and types.");
  bind_columns(bound, gaussian_columns(), 4, &set_gaussian_column);
  bound.def_property_readonly(
      "harmonics",
      [](const std::shared_ptr<HeldGaussians>& self) -> py::array {
        GaussianCloud& cloud = self->value;
        const Shape shape{static_cast<py::ssize_t>(cloud.size()),
                          static_cast<py::ssize_t>(stride_of(cloud) / 3), 3};
        if (cloud.size() == 0) return py::array(py::dtype::of<float>(), shape);
        return py::array(py::dtype::of<float>(), shape, cloud.harmonics.data(), py::cast(self));
      },
      "float32 (N, K, 3). Coefficients of the spherical harmonics R G B; K = (degree + 1)^2.");
  bound.def_property_readonly(
      "degree", [](const HeldGaussians& self) { return self.value.degree; },
      "Degree of the spherical harmonics, 0 to 4.");
  bound.def_property_readonly(
      "origin", [](const HeldGaussians& self) { return tuple_of(self.value.origin); },
      "World coordinates that `positions` are relative to.");
  bound.def("__len__", [](const HeldGaussians& self) { return self.value.size(); });
  bound.def("__repr__", [](const HeldGaussians& self) {
    return description("GaussianCloud", self.value.size(), "Gaussians", self.value,
                       gaussian_columns());
  });
  bound.def(
      "__getitem__",
      [](HeldGaussians& self, const py::object& key) {
        const GaussianCloud& from = ready(self);
        const Array<std::uint32_t> rows = rows_chosen(key, from.size());
        GaussianCloud part = from.without_gaussians();
        part.resize(rows.size());
        for (std::size_t i = 0; i < rows.size(); ++i) part.assign(i, from, rows[i]);
        return hold(std::move(part));
      },
      py::arg("key"), "New Gaussians of the rows that a slice, a mask or indices choose.");
}

// Files.

void bind_files(py::module_& module) {
  module.def("file_kind", [](const std::string& path) {
    switch (made([&] { return file_kind(path); })) {
      case FileKind::kCloud:
        return "points";
      case FileKind::kMesh:
        return "mesh";
      case FileKind::kImage:
        return "image";
      case FileKind::kGaussians:
        return "gaussians";
      case FileKind::kVolume:
        break;
    }
    return "volume";
  });
  module.def("read_points", [](const std::string& path, const py::dict& given,
                               const py::object& progress, std::optional<int> threads) {
    CloudReadOptions options;
    Options take(given);
    std::optional<std::pair<std::array<double, 3>, std::array<double, 3>>> bounds;
    take("every", options.every);
    take("level", options.level);
    take("bounds", bounds);
    take("columns", options.columns);
    if (bounds) options.bounds = Bounds{Vec3d(bounds->first.data()), Vec3d(bounds->second.data())};
    return hold(made({progress, threads}, [&] { return read_cloud(path, options); }));
  });
  module.def("read_mesh",
             [](const std::string& path) { return hold(made([&] { return read_mesh(path); })); });
  module.def("read_gaussians", [](const std::string& path) {
    return hold(made([&] { return read_gaussians(path); }));
  });
  module.def("write_points",
             [](const std::string& path, HeldCloud& held, bool ascii, bool no_clobber) {
               const SurfelCloud& cloud = ready(held);
               const InUse use(held);
               run([&] { write_cloud(cloud, path, {.no_clobber = no_clobber, .ascii = ascii}); });
             });
  module.def("write_mesh", [](const std::string& path, HeldMesh& held, bool no_clobber) {
    const TriangleMesh& mesh = ready(held);
    const InUse use(held);
    run([&] { write_mesh(mesh, path, {.no_clobber = no_clobber}); });
  });
  module.def("write_gaussians", [](const std::string& path, HeldGaussians& held, bool no_clobber) {
    const GaussianCloud& cloud = ready(held);
    const InUse use(held);
    run([&] { write_gaussians(cloud, path, {.no_clobber = no_clobber}); });
  });
}

void require_together(const SurfelCloud& cloud, const std::vector<const char*>& attributes) {
  const auto there = [&](const char* attribute) {
    return surfel_column(attribute).rows(cloud) > 0;
  };
  const auto count = std::count_if(attributes.begin(), attributes.end(), there);
  if (count == 0 || count == static_cast<std::ptrdiff_t>(attributes.size())) return;
  std::string names;
  for (const char* attribute : attributes) {
    names += (names.empty() ? "`" : ", `") + std::string(attribute) + "`";
  }
  throw_input("", names + " come together, but " +
                      (there(attributes.front()) ? "some are" : "the first is") +
                      " missing; assign all or none");
}

}  // namespace

SurfelCloud& ready(HeldCloud& held) {
  SurfelCloud& cloud = held.value;
  if (held.positions_seen && *held.positions_seen != hash_of(cloud)) {
    cloud.decimals.reset();
    cloud.las.reset();
    held.positions_seen.reset();
  }
  require_together(cloud, {"tangents", "variance_u", "variance_v"});
  require_together(cloud, {"clip1", "clip1_distance"});
  require_together(cloud, {"clip2", "clip2_distance"});
  require_together(cloud, {"dpdu", "dpdv"});
  cloud.check_columns("");
  return cloud;
}

TriangleMesh& ready(HeldMesh& held) {
  TriangleMesh& mesh = held.value;
  mesh.check_columns("");
  if (!mesh.material.empty()) mesh.check_materials("");
  for (std::size_t i = 0; i < mesh.position.size(); ++i) {
    if (mesh.position[i].allFinite()) continue;
    throw_input("", "vertex " + std::to_string(i) + " of the mesh is not finite");
  }
  return mesh;
}

GaussianCloud& ready(HeldGaussians& held) {
  GaussianCloud& cloud = held.value;
  const std::size_t stride = stride_of(cloud);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float* const h = cloud.harmonics.data() + i * stride;
    const bool usable = cloud.position[i].allFinite() && cloud.scale[i].allFinite() &&
                        cloud.scale[i].minCoeff() >= 0 &&
                        double{cloud.scale[i].maxCoeff()} <= kLargestExtent &&
                        std::all_of(cloud.rotation[i].begin(), cloud.rotation[i].end(),
                                    [](float v) { return std::isfinite(v); }) &&
                        std::isfinite(cloud.amplitude[i]) && cloud.amplitude[i] >= 0 &&
                        std::all_of(h, h + stride, [](float v) { return std::isfinite(v); });
    if (usable) continue;
    throw_input("", "Gaussian " + std::to_string(i) +
                        " has a value that is not finite, or a scale or opacity below 0; leave it "
                        "out: gaussians[mask]");
  }
  return cloud;
}

py::array linear_colors(const py::object& given, const std::vector<py::ssize_t>& shape,
                        const std::string& name) {
  const py::array array = py::module_::import("numpy").attr("asarray")(given);
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

void bind_clouds(py::module_& module) {
  bind_surfels(module);
  bind_meshes(module);
  bind_gaussians(module);
  bind_files(module);
}

}  // namespace surfel::python
