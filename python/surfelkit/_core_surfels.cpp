// Surfels, whose columns NumPy sees in their place.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string_view>

#include "_columns.h"

namespace surfel::python {
namespace {

/// The columns of docs/format.md without `radius`, a number that the variances tell.
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

std::size_t hash_of(const SurfelCloud& cloud) {
  return std::hash<std::string_view>()(
      {reinterpret_cast<const char*>(cloud.position.data()), cloud.size() * sizeof(Vec3f)});
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
  assign(held, column, values, cloud.size(), "surfels");
  if (attribute != "colors") return;
  const py::array array = as_array(given);
  cloud.color_encoding = array.dtype().kind() != 'u' ? ColorEncoding::kFloatLinear
                         : array.itemsize() == 1     ? ColorEncoding::kUint8Srgb
                                                     : ColorEncoding::kUint16Srgb;
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
  const py::array array = as_array(given);
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

std::optional<Vec3d> vector_of(const std::optional<std::array<double, 3>>& v) {
  return v ? std::optional(Vec3d(v->data())) : std::nullopt;
}

const Choices<ColorLight>& color_lights() {
  static const Choices<ColorLight> all{{"recorded", ColorLight::kRecorded},
                                       {"reflectance", ColorLight::kReflectance},
                                       {"mixed", ColorLight::kMixed}};
  return all;
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

/// Lines of a file, whatever its bytes are.
py::list lines_of(const std::vector<std::string>& lines) {
  py::list out;
  for (const std::string& line : lines) out.append(text_of(line));
  return out;
}

}  // namespace

SurfelCloud& ready(HeldCloud& held) {
  SurfelCloud& cloud = held.value;
  if (held.positions_seen && held.users == 0 && *held.positions_seen != hash_of(cloud)) {
    cloud.decimals.reset();
    cloud.las.reset();
    held.positions_seen.reset();
  }
  require_together(cloud, {"tangents", "variance_u", "variance_v"});
  require_together(cloud, {"clip1", "clip1_distance"});
  require_together(cloud, {"clip2", "clip2_distance"});
  if (!cloud.clip2.empty() && cloud.clip1.empty()) {
    throw_input("", "there is `clip2` without `clip1`; assign the first half-planes to `clip1`");
  }
  require_together(cloud, {"dpdu", "dpdv"});
  cloud.check_columns("");
  return cloud;
}

void bind_surfels(py::module_& module) {
  using Class = py::class_<HeldCloud, std::shared_ptr<HeldCloud>>;
  Class bound(module, "SurfelCloud",
              "Surfels or points: a structure of arrays, one row each.\n\n"
              "Attributes are NumPy views of the cloud's own memory, so that writing to them\n"
              "changes the cloud, and they outlive it; columns that the cloud lacks are None.\n"
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
  bind_columns(bound, surfel_columns(), 1, &set_column,
               [](HeldCloud& self, const Column<SurfelCloud>& column) {
                 if (&column == &surfel_columns().front()) note_positions(self);
               });
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
        require_unused(self);
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
        require_unused(self);
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
        require_unused(self);
        std::string known;
        for (const auto& [name, light] : color_lights()) {
          if (given == name) {
            self.value.color_light = light;
            return;
          }
          known += std::string(name) + ", ";
        }
        if (given) {
          throw_usage("`color_light` is '" + *given + "'; it must be " + known + "or None");
        }
        self.value.color_light = ColorLight::kUnsaid;
      },
      "What the colours are: 'recorded' light, which is shown as it is, the surface's own\n"
      "'reflectance', which is lit, or 'mixed'; None: nobody has said, taken for recorded.");
  bound.def_property(
      "provenance", [](const HeldCloud& self) { return lines_of(self.value.provenance); },
      [](HeldCloud& self, std::vector<std::string> lines) {
        require_unused(self);
        self.value.provenance = std::move(lines);
      },
      "Lines that tell how the cloud was made; a list of its own.");
  bound.def_property(
      "comments", [](const HeldCloud& self) { return lines_of(self.value.comments); },
      [](HeldCloud& self, std::vector<std::string> lines) {
        require_unused(self);
        self.value.comments = std::move(lines);
      },
      "Other comments of the file; a list of its own.");
  bound.def("_column_names", &column_names);
  bound.def("_column", &named_column);
  bound.def("_set_column", &set_named_column);
  bound.def("_remove_column", &remove_named_column);
}

}  // namespace surfel::python
