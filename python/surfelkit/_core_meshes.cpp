// Meshes, and Gaussians in space, whose columns NumPy sees in their place.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "_columns.h"

namespace surfel::python {
namespace {

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

/// Rows of a column that the mesh may have or not.
std::size_t rows_of(const TriangleMesh& mesh, const std::string& attribute) {
  return attribute == "vertex_colors" ? mesh.position.size() : mesh.face.size();
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

constexpr auto kNothing = [](const auto&, const auto&) {};

}  // namespace

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

void bind_meshes(py::module_& module) {
  using Class = py::class_<HeldMesh, std::shared_ptr<HeldMesh>>;
  Class bound(module, "TriangleMesh",
              "Triangles. Attributes are NumPy views, as SurfelCloud has them.");
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
  bind_columns(bound, mesh_columns(), 2, &set_mesh_column, kNothing);
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

void bind_gaussians(py::module_& module) {
  using Class = py::class_<HeldGaussians, std::shared_ptr<HeldGaussians>>;
  Class bound(module, "GaussianCloud",
              "Gaussians in space, such as trained splats. Attributes are NumPy views, as\n"
              "SurfelCloud has them; the number of Gaussians is fixed.");
  bound.def_static(
      "from_arrays", &gaussians_from_arrays, py::arg("positions"), py::arg("scales"),
      py::arg("rotations"), py::arg("opacities"), py::arg("harmonics"),
      "Gaussians of arrays, which are copied: (N, 3), (N, 3), (N, 4), (N,), (N, K, 3) with\n"
      "K = (degree + 1)^2, values as the attributes of the same names have them.\n\n"
      "Raises InputError for other shapes and types.");
  bind_columns(bound, gaussian_columns(), 4, &set_gaussian_column, kNothing);
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

}  // namespace surfel::python
