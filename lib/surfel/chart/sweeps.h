#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/chart/tool_chain.h>

namespace surfel {

/// The facts that decide which sweeps and settings make sense.
struct SweepContext {
  bool mesh = false;           ///< The input is a mesh, which is sampled.
  bool texture = false;        ///< There is an image to fit coefficients to.
  bool outside_truth = false;  ///< The truth is the mesh or a picture, not the surfels themselves.
  bool transparent = false;    ///< Some surfels or materials are see-through.
  std::size_t surfels = 0;     ///< Surfels of the input, or samples of the mesh.
  double cutoff = 1;           ///< Cutoff in force where the user gave one to surfel-render.
  int cores = 1;
};

/// One setting of a sweep.
struct SweepPoint {
  std::string label;    ///< Value with its unit, short.
  std::string changes;  ///< Changes of the tools' options, as ToolChain::apply() takes them.
  bool quick = false;   ///< A quick run measures it, too.
};

/// A family of settings to chart. The default of the tools is a point besides `points`.
struct Sweep {
  std::string name;
  std::string title;             ///< Name of the setting that is varied, for a heading.
  std::string about;             ///< A sentence or two for the report.
  std::string standard;          ///< Label of the default.
  Stage timed = Stage::kRender;  ///< The tool whose time is the cost.
  std::string base{};            ///< Changes that all points and the default share.
  std::string truth{};           ///< Options of surfel-render for the reference alone.
  std::vector<SweepPoint> points{};
  std::string needs{};  ///< Not empty: the sweep makes no sense here for want of this.
};

/// All sweeps, in the order of the report.
SURFEL_API std::vector<Sweep> all_sweeps(const SweepContext& context);

/// Throws Error(kUsage) for a name that is not known; the message lists the known ones.
SURFEL_API void require_known_sweeps(const std::vector<std::string>& names);

/// The sweeps of these names, in the order of all_sweeps(); of no names, all that make sense.
/// Throws Error(kUsage) as require_known_sweeps() does, and for a sweep that makes no sense: the
/// message says what it needs.
SURFEL_API std::vector<Sweep> choose_sweeps(const std::vector<std::string>& names,
                                            const SweepContext& context);

/// The settings that a recommendation chooses from: they trade time for accuracy in a picture.
SURFEL_API std::vector<SweepPoint> recommendation_candidates(const SweepContext& context);

}  // namespace surfel
