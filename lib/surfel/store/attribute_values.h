#pragma once

// Values that surfels have besides their colours, by name: where they lie, how large they are, and
// the columns of their file.

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

/// What the values of an attribute are.
enum class AttributeKind : std::uint8_t {
  kNumber,    ///< A quantity, with a range.
  kCategory,  ///< Whole numbers that name things: groups, materials, labels.
  kLasClass,  ///< A category whose numbers have names (scene/color_map.h).
  kNormal     ///< The unit normal: three numbers, which have a colour without a range.
};

/// Values of an attribute, of all surfels.
struct AttributeSummary {
  std::size_t count = 0;    ///< Surfels that can be drawn and have a value.
  std::size_t missing = 0;  ///< Surfels that can be drawn, and whose value is no finite number.
  double min = 0, max = 0;
  /// The values below which 1, 50 and 99 in 100 surfels are: exact up to 2^20 surfels, else of 2^20
  /// surfels chosen by a hash of their numbers.
  double percentile_1 = 0, median = 0, percentile_99 = 0;
  /// percentile_1 and percentile_99 of the surfels without those that lie far from most others
  /// (CoordinateSpread::core()).
  std::pair<double, double> core{0, 0};
  /// Of categories: surfels of each number, of kMostCategories numbers at most; the numbers left
  /// out are the largest.
  std::map<std::int64_t, std::size_t> categories = {};
  static constexpr std::size_t kMostCategories = 4096;

  /// A range for colours that neither stray values nor stray points stretch: `core`, or all values
  /// where its ends agree.
  SURFEL_API std::pair<double, double> robust_range() const;
};

class AttributeSurvey;

/// An attribute of the surfels of a source, which must outlive it.
class SURFEL_API AttributeValues {
 public:
  /// The names that need no column: elevation (along `up`), x, y, z, normal, radius (of the disc at
  /// cutoff 1), spacing (root of the area) and density (surfels per unit^2); then the source's
  /// columns, see SurfelSource::columns(), which win over those names. Names that a source has no
  /// values for are left out.
  static std::vector<std::string> names(const SurfelSource& source);
  /// The attribute that `name` stands for in this source: one of names(), whatever its case and
  /// without the "scalar_" that some programs begin columns with; "intensity" also stands for
  /// reflectance, reflectivity and remission, "classification" for class and label. Nullopt if
  /// there is none.
  static std::optional<std::string> find(const SurfelSource& source, const std::string& name);
  /// Does an attribute tell of a surfel's size? Then surfels of coarser levels of detail, which are
  /// larger, have other values than the surfels that they stand for.
  static bool of_size(const std::string& name);

  /// Throws Error(kInput) naming `file` and the attributes that there are if `name` is none.
  /// \param source  The surfels, which must outlive the values.
  /// \param name    The attribute, as find() takes it.
  /// \param up      Direction of elevation, world coordinates; made unit.
  /// \param file    The file of the surfels, for messages.
  AttributeValues(const SurfelSource& source, const std::string& name, const Vec3d& up,
                  const std::string& file);

  const std::string& name() const { return name_; }  ///< As names() has it.
  AttributeKind kind() const { return kind_; }
  /// Takes values for numbers or for categories, of which only whole numbers are values. The kind
  /// before and after is not kNormal.
  void take_for(AttributeKind kind) { kind_ = kind; }

  /// Writes the values of surfels [begin, end), which the source has filled into `rows` from row
  /// `row` on. NaN where there is none. The kind is not kNormal. Callable from any thread.
  void values(std::size_t begin, std::size_t end, const RenderCloud& rows, std::size_t row,
              double* to) const;
  /// Reads surfels [begin, end) once.
  AttributeSummary summary(std::size_t begin, std::size_t end) const;

 private:
  friend class AttributeSurvey;
  void add_to(AttributeSurvey& to, std::size_t begin, std::size_t end) const;

  enum class Origin : std::uint8_t { kPosition, kNormal, kRadius, kSpacing, kDensity, kColumn };
  const SurfelSource& source_;
  std::string name_;
  AttributeKind kind_ = AttributeKind::kNumber;
  Origin origin_ = Origin::kColumn;
  Vec3d along_{0, 0, 0};    ///< Of kPosition.
  std::size_t column_ = 0;  ///< Of kColumn.
};

/// The summary of an attribute of surfels that come piece by piece.
class SURFEL_API AttributeSurvey {
 public:
  /// \param total  number of surfels that will be added
  explicit AttributeSurvey(std::size_t total);
  ~AttributeSurvey();
  AttributeSurvey(AttributeSurvey&&) noexcept;

  /// Adds surfels [begin, end) of a source, which come after all that were added before.
  void add(const AttributeValues& values, std::size_t begin, std::size_t end);
  /// As AttributeValues::summary() of all surfels at once; to be called once.
  AttributeSummary summary();

 private:
  friend class AttributeValues;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Names of all attributes of a cloud but `normal`; attributes of size only where the surfels have
/// variances.
SURFEL_API std::vector<std::string> measured_attributes(const SurfelCloud& cloud);
/// The summaries of measured_attributes().
SURFEL_API std::vector<std::pair<std::string, AttributeSummary>> summarize_attributes(
    const SurfelCloud& cloud, const Vec3d& up);

}  // namespace surfel
