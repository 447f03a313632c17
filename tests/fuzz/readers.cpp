#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/io/camera_file.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/colmap.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/gaussian_levels.h>
#include <surfel/io/image_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/mtl.h>
#include <surfel/io/scene_file.h>
#include <surfel/io/view_file.h>
#include <surfel/io/volume_io.h>
#include <surfel/scene/view.h>

#include "fuzz/checks.h"
#include "fuzz/fuzzers.h"
#include "support/e57_file.h"

namespace surfel::fuzz {
namespace {

/// Files lie in a folder that there is not, so that the files that they name are not found.
InputFile file_of(Bytes bytes, const char* extension) {
  return {std::string("/fuzz/file") + extension, bytes};
}

/// Calls read(), which must end well or with an Error whose message names the file.
template <class Read>
void read_or_refuse(const Read& read) {
  try {
    read();
  } catch (const Error& error) {
    require(std::string_view(error.what()).find("/fuzz/file") != std::string_view::npos,
            std::string("a message does not name the file: ") + error.what());
  }
}

void cloud(Bytes bytes, const char* extension, bool levels = false) {
  read_or_refuse([&] {
    read_cloud(file_of(bytes, extension), {.levels = levels}).check_columns("the cloud");
  });
}

/// Does a LAS header count so many points that decoding them takes longer than a fuzzer may? Equal
/// points take next to no bytes where they are compressed.
bool promises_many_points(Bytes bytes) {
  constexpr std::size_t kMinorAt = 25;
  constexpr std::size_t kCountAt = 107;
  constexpr std::size_t kWideCountAt = 247;
  constexpr std::uint64_t kMost = 20000;
  std::uint32_t count = 0;
  std::uint64_t wide = 0;
  if (bytes.size() < kCountAt + sizeof(count)) return false;
  std::memcpy(&count, bytes.data() + kCountAt, sizeof(count));
  if (bytes[kMinorAt] < std::byte{4}) return count > kMost;
  if (bytes.size() >= kWideCountAt + sizeof(wide)) {
    std::memcpy(&wide, bytes.data() + kWideCountAt, sizeof(wide));
  }
  return std::max<std::uint64_t>(count, wide) > kMost;
}

void las(Bytes bytes, const char* extension) {
  if (!promises_many_points(bytes)) cloud(bytes, extension);
}

void copc(Bytes bytes) {
  if (promises_many_points(bytes)) return;
  const Bounds box{Vec3d(-1, -1, -1), Vec3d(700, 700, 700)};
  read_or_refuse([&] {
    read_cloud(file_of(bytes, ".laz"), {.level = 2, .bounds = box}).check_columns("the cloud");
  });
}

/// The bytes are what the pages of a file hold, since no fuzzer guesses checksums.
void e57(Bytes bytes) {
  const std::string file = test::with_checksums(std::string(as_text(bytes)));
  cloud(std::as_bytes(std::span(file)), ".e57");
}

void named_columns(Bytes bytes) {
  read_or_refuse([&] {
    read_cloud(file_of(bytes, ".csv"), {.columns = {"x", "y", "z", "-", "r", "g", "b"}})
        .check_columns("the cloud");
  });
}

void require_drawable(const GaussianCloud& cloud) {
  require(cloud.size() > 0 && cloud.scale.size() == cloud.size() &&
              cloud.rotation.size() == cloud.size() && cloud.amplitude.size() == cloud.size() &&
              cloud.harmonics.size() == cloud.size() * cloud.harmonics_stride(),
          "columns of Gaussians differ in length");
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector4f rotation(cloud.rotation[i].data());
    require(cloud.position[i].allFinite() && cloud.scale[i].allFinite() &&
                cloud.scale[i].minCoeff() >= 0 && std::isfinite(cloud.amplitude[i]) &&
                std::abs(rotation.norm() - 1) < 1e-5F,
            "a Gaussian that was read cannot be drawn");
  }
  require(std::all_of(cloud.harmonics.begin(), cloud.harmonics.end(),
                      [](float value) { return std::isfinite(value); }),
          "a colour is not finite");
}

/// All Gaussians that are read can be drawn.
void gaussians(Bytes bytes, const char* extension) {
  read_or_refuse([&] { require_drawable(read_gaussians(file_of(bytes, extension))); });
}

/// All Gaussians of every level of detail that is read can be drawn.
void gaussian_levels(Bytes bytes) {
  read_or_refuse([&] {
    const GaussianLevels levels(file_of(bytes, ".ply"));
    for (std::uint32_t c = 0; c < levels.head().tree.size(); ++c) {
      require_drawable(levels.read(std::span(&c, 1)));
    }
  });
}

/// The bytes are what a .ksplat file of two sections means, without the room that it leaves: 48
/// bytes of each header, then the sections.
void ksplat(Bytes bytes) {
  constexpr std::size_t kMeant = 48;
  std::string file;
  for (const std::size_t room : {4096, 1024, 1024}) {
    const Bytes part = bytes.first(std::min(kMeant, bytes.size()));
    bytes = bytes.subspan(part.size());
    file += as_text(part);
    file.append(room - part.size(), '\0');
  }
  file += as_text(bytes);
  gaussians(std::as_bytes(std::span(file)), ".ksplat");
}

void mesh(Bytes bytes, const char* extension) {
  read_or_refuse([&] { read_mesh(file_of(bytes, extension)).check_columns("the mesh"); });
}

/// Bytes of other formats are left to the libraries that know them.
void volume(Bytes bytes, const char* extension) {
  read_or_refuse([&] {
    const Volume volume = read_volume(file_of(bytes, extension));
    require(volume.value.size() == volume.voxels() && volume.voxels() > 0,
            "a volume has other than its voxels");
    require(std::all_of(volume.value.begin(), volume.value.end(),
                        [](float value) { return std::isfinite(value); }),
            "a voxel is not finite");
  });
}

void image(Bytes bytes, const char* extension, std::string_view magic) {
  if (!as_text(bytes).starts_with(magic)) return;
  set_most_image_pixels(1 << 12);
  read_or_refuse([&] { read_image(file_of(bytes, extension)); });
}

void material(Bytes bytes) {
  read_or_refuse([&] { read_mtl(file_of(bytes, ".mtl")); });
}

void scene(Bytes bytes) {
  read_or_refuse([&] {
    require(read_scene(file_of(bytes, ".toml")).problems().empty(),
            "a scene that was read has problems");
  });
}

void camera(Bytes bytes) {
  read_or_refuse([&] {
    for (const CameraOptions& camera : read_cameras(file_of(bytes, ".toml"), {})) {
      require(camera.problems().empty(), "a camera that was read has problems");
    }
  });
}

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

void require_usable(const std::vector<View>& views) {
  for (const View& view : views) {
    require(view.camera.problems().empty(), "a view that was read has problems");
  }
}

/// The bytes are the cameras of a valid file of images, then the images of valid cameras.
void colmap(Bytes bytes, const char* extension, std::string_view cameras, std::string_view images) {
  const auto file = [&](Bytes contents) { return file_of(contents, extension); };
  read_or_refuse([&] { require_usable(read_colmap(file(bytes), file(bytes_of(images)))); });
  read_or_refuse([&] { require_usable(read_colmap(file(bytes_of(cameras)), file(bytes))); });
}

void colmap_text(Bytes bytes) {
  colmap(bytes, ".txt", "1 PINHOLE 8 6 9 9 4 3\n", "1 1 0 0 0 0 0 0 1 a.jpg\n\n");
}

void colmap_binary(Bytes bytes) {
  using namespace std::string_view_literals;
  colmap(bytes, ".bin",
         // One camera, number 1, of model 1, 8 x 6 pixels: 8, 8, 4, 4.
         "\1\0\0\0\0\0\0\0\1\0\0\0\1\0\0\0\x8\0\0\0\0\0\0\0\6\0\0\0\0\0\0\0"
         "\0\0\0\0\0\0\x20\x40\0\0\0\0\0\0\x20\x40"
         "\0\0\0\0\0\0\x10\x40\0\0\0\0\0\0\x10\x40"sv,
         // One image, number 1, not turned, of camera 1, without points.
         "\1\0\0\0\0\0\0\0\1\0\0\0\0\0\0\0\0\0\xf0\x3f"
         "\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0"
         "\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0"
         "\1\0\0\0\x61\0\0\0\0\0\0\0\0\0"sv);
}

void views(Bytes bytes) {
  read_or_refuse([&] {
    const ViewFileOptions options{.width = 8, .height = 6};
    require_usable(read_views(file_of(bytes, ".json"), options));
  });
}

constexpr Fuzzer kReaders[] = {
    {"cloud_ply", [](Bytes bytes) { cloud(bytes, ".ply"); }},
    {"cloud_levels", [](Bytes bytes) { cloud(bytes, ".ply", true); }},
    {"cloud_pcd", [](Bytes bytes) { cloud(bytes, ".pcd"); }},
    {"cloud_las", [](Bytes bytes) { las(bytes, ".las"); }},
    {"cloud_laz", [](Bytes bytes) { las(bytes, ".laz"); }},
    {"cloud_copc", copc},
    {"cloud_text", [](Bytes bytes) { cloud(bytes, ".xyz"); }},
    {"cloud_columns", named_columns},
    {"cloud_e57", e57},
    {"cloud_expe", [](Bytes bytes) { cloud(bytes, ".pts"); }},
    {"cloud_ptx", [](Bytes bytes) { cloud(bytes, ".ptx"); }},
    {"gaussian_ply",
     [](Bytes bytes) {
       gaussians(bytes, ".ply");
       gaussian_levels(bytes);
     }},
    {"gaussian_splat", [](Bytes bytes) { gaussians(bytes, ".splat"); }},
    {"gaussian_spz", [](Bytes bytes) { gaussians(bytes, ".spz"); }},
    {"gaussian_ksplat", ksplat},
    {"volume_nrrd", [](Bytes bytes) { volume(bytes, ".nrrd"); }},
    {"volume_mha", [](Bytes bytes) { volume(bytes, ".mha"); }},
    {"mesh_ply", [](Bytes bytes) { mesh(bytes, ".ply"); }},
    {"mesh_obj", [](Bytes bytes) { mesh(bytes, ".obj"); }},
    {"mesh_stl", [](Bytes bytes) { mesh(bytes, ".stl"); }},
    {"mesh_off", [](Bytes bytes) { mesh(bytes, ".off"); }},
    {"mesh_gltf", [](Bytes bytes) { mesh(bytes, ".gltf"); }},
    {"image_png", [](Bytes bytes) { image(bytes, ".png", "\x89PNG\r\n\x1a\n"); }},
    {"image_exr", [](Bytes bytes) { image(bytes, ".exr", "\x76\x2f\x31\x01"); }},
    {"material", material},
    {"scene", scene},
    {"camera", camera},
    {"colmap_text", colmap_text},
    {"colmap_binary", colmap_binary},
    {"views", views},
};

}  // namespace

std::span<const Fuzzer> readers() { return kReaders; }

}  // namespace surfel::fuzz
