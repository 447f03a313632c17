#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

class RenderCloud;

/// Attributes that a source may have besides positions and variances.
struct SurfelAttributes {
  bool anisotropic = false;
  bool normal = false;
  bool shading_normal = false;
  bool area = false;
  bool clip1 = false;
  bool clip2 = false;
  bool color = false;
  bool alpha = false;
  bool material = false;
  bool group = false;
  bool group_radius = false;
  bool source = false;  ///< See SurfelCloud::source.
};

/// Names of whole numbers of a surfel among SurfelSource::columns().
inline constexpr const char* kMaterialColumn = "material";
inline constexpr const char* kGroupColumn = "group";
inline constexpr const char* kLevelColumn = "level";

/// Surfels in any order, from which the columns of a RenderCloud are filled, range by range.
class SurfelSource {
 public:
  SurfelSource() = default;
  virtual ~SurfelSource() = default;
  SurfelSource(const SurfelSource&) = delete;
  SurfelSource& operator=(const SurfelSource&) = delete;

  virtual std::size_t size() const = 0;
  virtual SurfelAttributes attributes() const = 0;
  /// Origin that positions are relative to, world coordinates.
  virtual Vec3d origin() const = 0;
  /// Moves the origin if surfels within these bounds, which are relative to the present origin, lie
  /// too far from it for the precision of float. True if the origin has moved, which makes the
  /// positions filled before void.
  virtual bool recenter(const Bounds& /*bounds*/) { return false; }
  /// Writes surfels [begin, end) to the columns that the cloud has, from row `row` on. A surfel
  /// that cannot be drawn gets a position that is NaN, a deviation or enlarged radius that is not
  /// finite or not positive, or a colour, alpha or area that is not finite. Callable from any
  /// thread.
  virtual void fill(std::size_t begin, std::size_t end, RenderCloud& cloud,
                    std::size_t row) const = 0;
  /// Writes SurfelCloud::source of surfels [begin, end). attributes().source is true.
  virtual void fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const = 0;
  /// Names of the columns that can be read as numbers: "material", "group" and "level" where there
  /// are such, then the properties that the library gives no meaning to.
  virtual std::vector<std::string> columns() const = 0;
  /// Writes the values of surfels [begin, end) in element `column` of columns(). Callable from any
  /// thread.
  virtual void fill_column(std::size_t column, std::size_t begin, std::size_t end,
                           double* to) const = 0;
  /// Announces that fill() will soon be called for surfels [begin, end).
  virtual void expect(std::size_t /*begin*/, std::size_t /*end*/) const {}

 protected:
  /// Turns raw attributes, as a cloud or file stores them, into the values that fill() promises, in
  /// `count` rows from `row` on. The columns of deviations hold variances before the call. Columns
  /// of attributes that are not known are filled with defaults. An opacity that nobody sees, below
  /// a millionth, becomes zero.
  static void make_drawable(const SurfelAttributes& known, RenderCloud& cloud, std::size_t row,
                            std::size_t count);
};

/// Source over an in-memory cloud, which must outlive it.
class SURFEL_API CloudSource : public SurfelSource {
 public:
  /// Whether surfels without variances are refused, or are points that have the variance 1.
  enum class Sizes : std::uint8_t { kNeeded, kAny };

  /// Throws Error(kInput) if the cloud's columns differ in length, or if it has no variance and
  /// needs it; `name` starts messages.
  CloudSource(const SurfelCloud& cloud, const std::string& name, Sizes sizes = Sizes::kNeeded);
  CloudSource(SurfelCloud&& cloud, const std::string& name, Sizes sizes = Sizes::kNeeded) = delete;

  std::size_t size() const override { return cloud_.size(); }
  SurfelAttributes attributes() const override;
  Vec3d origin() const override { return cloud_.origin; }
  void fill(std::size_t begin, std::size_t end, RenderCloud& cloud, std::size_t row) const override;
  void fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const override;
  std::vector<std::string> columns() const override;
  void fill_column(std::size_t column, std::size_t begin, std::size_t end,
                   double* to) const override;

 private:
  const SurfelCloud& cloud_;
};

/// The surfels of another source, which must outlive it; derived classes change what they fill.
class ForwardingSource : public SurfelSource {
 public:
  explicit ForwardingSource(SurfelSource& inner) : inner_(inner) {}

  std::size_t size() const override { return inner_.size(); }
  SurfelAttributes attributes() const override { return inner_.attributes(); }
  Vec3d origin() const override { return inner_.origin(); }
  bool recenter(const Bounds& bounds) override { return inner_.recenter(bounds); }
  void fill(std::size_t begin, std::size_t end, RenderCloud& cloud,
            std::size_t row) const override {
    inner_.fill(begin, end, cloud, row);
  }
  void fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const override {
    inner_.fill_sources(begin, end, to);
  }
  std::vector<std::string> columns() const override { return inner_.columns(); }
  void fill_column(std::size_t column, std::size_t begin, std::size_t end,
                   double* to) const override {
    inner_.fill_column(column, begin, end, to);
  }
  void expect(std::size_t begin, std::size_t end) const override { inner_.expect(begin, end); }

 private:
  SurfelSource& inner_;
};

/// Throws the error of surfels without variance; `file` may be empty.
[[noreturn]] void throw_no_variance(const std::string& file);

}  // namespace surfel
