#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

#include <support/adversarial_clouds.h>

namespace surfel::test {
namespace {

using Point = std::array<double, 3>;

/// What the file has of a surfel. Single precision is what the files of most programs have.
struct Surfel {
  Point p{}, n{0, 0, 1};
  double variance = 0;
  double area = 0;
  std::array<double, 3> color{};
  double alpha = 1;
};
using Surfels = std::vector<Surfel>;

/// Place i of n on the unit sphere, evenly spread along a spiral (Fibonacci's).
Point on_sphere(std::size_t i, std::size_t n) {
  const double z = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(n);
  const double angle = static_cast<double>(i) * std::numbers::pi * (3 - std::sqrt(5.0));
  const double r = std::sqrt(std::max(0.0, 1 - z * z));
  return {r * std::cos(angle), r * std::sin(angle), z};
}

Surfels sphere(std::size_t n) {
  Surfels surfels(n);
  for (std::size_t i = 0; i < n; ++i) {
    Surfel& s = surfels[i];
    s.p = s.n = on_sphere(i, n);
    s.area = s.variance = 4 * std::numbers::pi / static_cast<double>(n);
    for (std::size_t k = 0; k < 3; ++k) s.color[k] = 0.5 + 0.5 * std::sin(5 * s.p[k]);
  }
  return surfels;
}

Point times(const Point& p, double factor) { return {p[0] * factor, p[1] * factor, p[2] * factor}; }

void scale(Surfel& s, double factor) {
  s.p = times(s.p, factor);
  s.variance *= factor * factor;
  s.area *= factor * factor;
}

struct CloudCase {
  AdversarialCase named;
  std::function<void(Surfels&)> change;  ///< Of a sphere.
};

/// Every surfel changed by itself.
std::function<void(Surfels&)> each(const std::function<void(Surfel&, std::size_t)>& change) {
  return [change](Surfels& surfels) {
    for (std::size_t i = 0; i < surfels.size(); ++i) change(surfels[i], i);
  };
}

std::vector<CloudCase> cloud_cases() {
  std::vector<CloudCase> cases = {
      {{"benign", "sphere"}, each([](Surfel&, std::size_t) {})},
      {{"equal", "all surfels at one place"}, each([](Surfel& s, std::size_t) {
         s.p = s.n = {0, 0, 1};
       })},
      {{"half-equal", "every second surfel at one place"}, each([](Surfel& s, std::size_t i) {
         if (i % 2 == 0) s.p = s.n = {0, 0, 1};
       })},
      {{"two-places", "all surfels at two places"}, each([](Surfel& s, std::size_t i) {
         s.p = s.n = {0, 0, i % 2 == 0 ? 1.0 : -1.0};
       })},
      {{"tenfold", "every surfel ten times"},
       [](Surfels& surfels) {
         for (std::size_t i = 0; i < surfels.size(); ++i) surfels[i] = surfels[i / 10 * 10];
       }},
      {{"line", "all surfels on a line"},
       [](Surfels& surfels) {
         const double n = static_cast<double>(surfels.size());
         for (std::size_t i = 0; i < surfels.size(); ++i) {
           surfels[i].p = {2 * static_cast<double>(i) / n - 1, 0, 0};
           surfels[i].n = {0, 0, 1};
           surfels[i].variance = surfels[i].area = 4 / (n * n);
         }
       }},
      {{"plane", "all surfels on a plane, in a grid"},
       [](Surfels& surfels) {
         const auto side =
             static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(surfels.size()))));
         const double step = 2 / static_cast<double>(side);
         for (std::size_t i = 0; i < surfels.size(); ++i) {
           surfels[i].p = {static_cast<double>(i % side) * step - 1,
                           static_cast<double>(i / side) * step - 1, 0};
           surfels[i].n = {0, 0, 1};
           surfels[i].variance = surfels[i].area = step * step;
         }
       }},
      {{"outlier", "one surfel at 1e15"},
       [](Surfels& surfels) {
         surfels.back().p = {1e15, 0, 0};
       }},
      {{"nested", "eight spheres in each other, each a hundredth of the next one"},
       each(
           [](Surfel& s, std::size_t i) { scale(s, std::pow(0.01, static_cast<double>(i % 8))); })},
      {{"crowd", "half of the surfels within a thousandth, none smaller"},
       each([](Surfel& s, std::size_t i) {
         if (i % 2 == 0) s.p = {1 + 0.001 * s.p[0], 0.001 * s.p[1], 0.001 * s.p[2]};
       })},
      {{"ten-discs", "ten discs a hundred times as large as the sphere"},
       [](Surfels& surfels) {
         for (std::size_t i = 0; i < 10; ++i) surfels[i * (surfels.size() / 10)].variance = 1e4;
       }},
      {{"all-huge", "all discs as large as the sphere"},
       each([](Surfel& s, std::size_t) { s.variance = 1; })},
      {{"radii", "radii over nine decades"}, each([](Surfel& s, std::size_t i) {
         s.variance = std::pow(10.0, -18.0 * static_cast<double>(i % 100) / 100);
       })},
      {{"denormal", "the sphere times 1e-40"},
       each([](Surfel& s, std::size_t) { scale(s, 1e-40); })},
      {{"denormal-spacing", "the sphere times 1e-40 around the origin, discs as they were"},
       each([](Surfel& s, std::size_t) { s.p = times(s.p, 1e-40); })},
  };
  for (const int exponent : {-30, -20, -10, 10, 15, 20, 30}) {
    const double factor = std::pow(10.0, exponent);
    const std::string name = "1e" + std::to_string(exponent);
    cases.push_back({{"scale-" + name, "the sphere times " + name},
                     each([factor](Surfel& s, std::size_t) { scale(s, factor); })});
  }
  const std::vector<std::pair<std::string, std::function<double&(Surfel&)>>> columns = {
      {"x", [](Surfel& s) -> double& { return s.p[0]; }},
      {"nx", [](Surfel& s) -> double& { return s.n[0]; }},
      {"variance", [](Surfel& s) -> double& { return s.variance; }},
      {"area", [](Surfel& s) -> double& { return s.area; }},
      {"red", [](Surfel& s) -> double& { return s.color[0]; }},
      {"alpha", [](Surfel& s) -> double& { return s.alpha; }},
  };
  for (const auto& [column, value] : columns) {
    const std::vector<std::pair<std::string, double>> values = {
        {"nan", std::numeric_limits<double>::quiet_NaN()},
        {"inf", std::numeric_limits<double>::infinity()}};
    for (const auto& [word, number] : values) {
      cases.push_back({{word + "-" + column, "every twentieth " + column + " is " + word},
                       each([value = value, number = number](Surfel& s, std::size_t i) {
                         if (i % 20 == 7) value(s) = number;
                       })});
    }
  }
  return cases;
}

template <class Value>
void append(std::string& bytes, Value value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  bytes.append(raw, sizeof value);
}

struct Mesh {
  std::vector<Point> vertices;
  std::vector<std::array<std::size_t, 3>> faces;
};

/// A sphere of rows of quadrangles, each of two triangles.
Mesh sphere_mesh(std::size_t faces) {
  const auto rows = static_cast<std::size_t>(std::sqrt(static_cast<double>(faces) / 4));
  const std::size_t columns = 2 * rows;
  Mesh mesh;
  for (std::size_t r = 0; r <= rows; ++r) {
    for (std::size_t c = 0; c <= columns; ++c) {
      const double polar = std::numbers::pi * static_cast<double>(r) / static_cast<double>(rows);
      const double turn =
          2 * std::numbers::pi * static_cast<double>(c) / static_cast<double>(columns);
      mesh.vertices.push_back(
          {std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn), std::cos(polar)});
    }
  }
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      const std::size_t v = r * (columns + 1) + c;
      mesh.faces.push_back({v, v + columns + 1, v + 1});
      mesh.faces.push_back({v + 1, v + columns + 1, v + columns + 2});
    }
  }
  return mesh;
}

struct MeshCase {
  AdversarialCase named;
  std::function<void(Mesh&)> change;  ///< Of a sphere.
};

/// Every vertex changed by itself.
std::function<void(Mesh&)> each_vertex(const std::function<void(Point&)>& change) {
  return
      [change](Mesh& mesh) { std::for_each(mesh.vertices.begin(), mesh.vertices.end(), change); };
}

std::vector<MeshCase> mesh_cases() {
  return {
      {{"benign", "sphere"}, each_vertex([](Point&) {})},
      {{"equal", "all vertices at one place"}, each_vertex([](Point& p) {
         p = {1, 2, 3};
       })},
      {{"line", "all vertices on a line"}, each_vertex([](Point& p) { p[1] = p[2] = 0; })},
      {{"slivers", "a sphere a millionth as wide as long"},
       each_vertex([](Point& p) { p[0] *= 1e-6; })},
      {{"needles", "triangles a million times as long as wide, crossing each other"},
       [](Mesh& mesh) {
         for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
           const Point a = on_sphere(f, mesh.faces.size());
           const std::size_t v = mesh.vertices.size();
           mesh.vertices.push_back(a);
           mesh.vertices.push_back(times(a, -1));
           mesh.vertices.push_back({a[0] + 1e-6, a[1], a[2] + 1e-6});
           mesh.faces[f] = {v, v + 1, v + 2};
         }
       }},
      {{"huge-triangle", "one triangle a thousand times as large as the sphere"},
       [](Mesh& mesh) {
         const std::size_t v = mesh.vertices.size();
         mesh.vertices.insert(mesh.vertices.end(),
                              {Point{-1e3, -1e3, 2}, Point{1e3, -1e3, 2}, Point{0, 1e3, 2}});
         mesh.faces.push_back({v, v + 1, v + 2});
       }},
      {{"outlier", "one vertex at 1e15"},
       [](Mesh& mesh) {
         mesh.vertices[mesh.vertices.size() / 2] = {1e15, 0, 0};
       }},
      {{"scale-1e-30", "the sphere times 1e-30"},
       each_vertex([](Point& p) { p = times(p, 1e-30); })},
      {{"scale-1e30", "the sphere times 1e30"}, each_vertex([](Point& p) { p = times(p, 1e30); })},
      {{"denormal", "the sphere times 1e-40"}, each_vertex([](Point& p) { p = times(p, 1e-40); })},
      {{"edge-fan", "all faces at one edge"},
       [](Mesh& mesh) {
         const std::size_t v = mesh.vertices.size();
         mesh.vertices.insert(mesh.vertices.end(), {Point{0, 0, -1}, Point{0, 0, 1}});
         for (auto& face : mesh.faces) face = {v, v + 1, face[0]};
       }},
      {{"vertex-fan", "all faces at one vertex"},
       [](Mesh& mesh) {
         for (auto& face : mesh.faces) face[0] = 0;
       }},
      {{"duplicates", "every face ten times"},
       [](Mesh& mesh) {
         for (std::size_t f = 0; f < mesh.faces.size(); ++f)
           mesh.faces[f] = mesh.faces[f / 10 * 10];
       }},
      {{"one-face", "one face as often as the sphere has faces"},
       [](Mesh& mesh) {
         std::fill(mesh.faces.begin(), mesh.faces.end(), mesh.faces[mesh.faces.size() / 2]);
       }},
      {{"not-finite", "every twentieth vertex is not a number"},
       [](Mesh& mesh) {
         for (std::size_t v = 7; v < mesh.vertices.size(); v += 20) {
           mesh.vertices[v][0] = std::numeric_limits<double>::quiet_NaN();
         }
       }},
  };
}

template <class Case>
const Case& find_case(const std::vector<Case>& cases, const std::string& name) {
  const auto found =
      std::find_if(cases.begin(), cases.end(), [&](const Case& c) { return c.named.name == name; });
  if (found == cases.end()) throw std::invalid_argument("no case " + name);
  return *found;
}

template <class Case>
std::vector<AdversarialCase> names(const std::vector<Case>& cases) {
  std::vector<AdversarialCase> named;
  for (const Case& c : cases) named.push_back(c.named);
  return named;
}

/// The first columns of a cloud, all of which are x y z, normal, variance, area, colour, alpha; and
/// group where `grouped` is set.
std::string ply(const std::string& name, std::size_t count, const std::vector<std::string>& columns,
                bool grouped) {
  Surfels surfels = sphere(count);
  find_case(cloud_cases(), name).change(surfels);
  std::string file =
      "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(count) + "\n";
  for (const std::string& column : columns) file += "property float " + column + "\n";
  if (grouped) file += "property ushort group\n";
  file += "end_header\n";
  for (std::size_t i = 0; i < count; ++i) {
    const Surfel& s = surfels[i];
    const double values[] = {s.p[0],     s.p[1], s.p[2],     s.n[0],     s.n[1],     s.n[2],
                             s.variance, s.area, s.color[0], s.color[1], s.color[2], s.alpha};
    for (std::size_t c = 0; c < columns.size(); ++c) append(file, static_cast<float>(values[c]));
    if (grouped) append(file, static_cast<std::uint16_t>(i % 8));
  }
  return file;
}

}  // namespace

std::vector<AdversarialCase> adversarial_clouds() { return names(cloud_cases()); }
std::vector<AdversarialCase> adversarial_meshes() { return names(mesh_cases()); }

std::string adversarial_cloud(const std::string& name, std::size_t count, bool grouped) {
  return ply(name, count,
             {"x", "y", "z", "nx", "ny", "nz", "variance", "area", "red", "green", "blue", "alpha"},
             grouped);
}

std::string adversarial_points(const std::string& name, std::size_t count) {
  return ply(name, count, {"x", "y", "z"}, false);
}

std::string adversarial_mesh(const std::string& name, std::size_t count) {
  Mesh mesh = sphere_mesh(count);
  find_case(mesh_cases(), name).change(mesh);
  std::string file;
  char line[128];
  for (const Point& p : mesh.vertices) {
    std::snprintf(line, sizeof line, "v %.9g %.9g %.9g\n", p[0], p[1], p[2]);
    file += line;
  }
  for (const auto& f : mesh.faces) {
    file += "f " + std::to_string(f[0] + 1) + " " + std::to_string(f[1] + 1) + " " +
            std::to_string(f[2] + 1) + "\n";
  }
  return file;
}

}  // namespace surfel::test
