#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/scene/surface_sample.h>
#include <surfel/store/render_cloud.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

/// What is known of surfels before they are decoded.
struct CloudFacts {
  SurfelSource& source;      ///< All surfels, coarsest level of detail first.
  std::size_t first_finest;  ///< First surfel of the finest level, which goes on to the last.
  std::optional<Viewpoint> viewpoint;   ///< SurfelCloud::viewpoint of the file.
  std::optional<Vec3d> up;              ///< SurfelCloud::up of the file.
  FunctionRef<SurfaceSample()> sample;  ///< LoadedCloud::sample(), which reads surfels.
};

/// What is kept of a file for drawing, and in how much memory.
struct CloudLoadOptions {
  RenderColumns columns = {};  ///< Columns that the compositing method reads.
  /// Bytes that the surfels and a picture's splats, tiles and A-buffers may take. Surfels that do
  /// not fit stay in their file and are streamed from it. Unset: three quarters of the memory that
  /// the machine has available.
  std::optional<std::uint64_t> memory = {};
  /// False if the picture needs all surfels in memory, as pictures of groups do.
  bool may_stream = true;
  /// Most surfels fetched at once where a file without levels of detail is streamed, >= 256; fewer
  /// are fetched where `memory` has no room for as many.
  std::size_t batch = std::size_t{1} << 20;
  bool sample = false;  ///< Take the sample that LoadedCloud::sample() gives.
  /// Called once, before surfels are decoded: returns a source to decode instead of the file's,
  /// such as a ColoredSource, or null. It lives as long as the file's source. Unset: none.
  std::function<std::unique_ptr<SurfelSource>(const CloudFacts& facts)> wrap = {};

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Surfels of a file, ready to be rendered: in memory, or streamed from the file.
class SURFEL_API LoadedCloud {
 public:
  /// Reads any file that read_cloud() reads, and holds the surfels that a RenderCloud would hold if
  /// it were made from the SurfelCloud that read_cloud() returns with all levels of detail. Binary
  /// PLY is decoded without a SurfelCloud in between, which is several times as fast, and faster
  /// still if the surfels of the file follow morton_order().
  ///
  /// A file can be streamed (CloudStream) if it is binary PLY whose vertices have scalar properties
  /// only, and either has levels of detail, or has no copies of splats and consecutive surfels lie
  /// close together. Levels of detail are streamed even where they would fit into memory, since a
  /// picture needs few of them.
  ///
  /// Throws Error(kUsage) for unusable options; what read_cloud() and RenderCloud throw; and
  /// Error(kInput) if no surfel can be drawn, or if the surfels neither fit into the memory given
  /// nor can be streamed. Messages name the file.
  LoadedCloud(const std::string& path, const CloudLoadOptions& options);
  /// Surfels that are in memory already; `name` starts messages. Throws as above. Keeps no
  /// reference to the cloud.
  LoadedCloud(const SurfelCloud& cloud, const std::string& name, const CloudLoadOptions& options);
  ~LoadedCloud();
  LoadedCloud(const LoadedCloud&) = delete;
  LoadedCloud& operator=(const LoadedCloud&) = delete;

  const RenderCloud& surfels() const;
  /// The store that pictures are drawn from: the surfels in memory, or a stream of the file.
  ClusterStore& store() const;
  /// Does the file have levels of detail, whether they were asked for or not?
  bool has_levels() const;
  /// SurfelCloud::basis_cutoff of the file.
  std::optional<double> basis_cutoff() const;
  /// SurfelCloud::viewpoint of the file.
  const std::optional<Viewpoint>& viewpoint() const;
  /// SurfelCloud::up of the file.
  const std::optional<Vec3d>& up() const;
  /// meaning_of_colors() of the file; reflectance where it says nothing and there is one colour.
  ColorLight color_light() const;
  /// A sample of the surface, if the options ask for it: of the coarsest level of detail that has
  /// as many surfels as a sample holds, so that little is read of a file with levels. The sample is
  /// the same whether surfels are in memory or streamed.
  const SurfaceSample& sample() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
