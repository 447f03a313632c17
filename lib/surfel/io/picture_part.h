#pragma once

// Pictures that are made in parts, each by a process of its own, and joined at last.

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>

namespace surfel {

/// The i-th of n parts of a picture.
struct PartNumber {
  int number = 1;  ///< From 1 on.
  int parts = 1;

  /// Of "3/8"; nullopt of anything else, such as "0/8" and "9/8".
  SURFEL_API static std::optional<PartNumber> parse(const std::string& text);

  /// Most parts that a picture of so many rows has, of kRowsTogether rows each.
  SURFEL_API static int most_parts(int height);
  /// The rows of this part of a picture. Parts follow one another from the top, make up the
  /// picture, and differ by kRowsTogether rows at most. `parts` is most_parts(height) at most.
  SURFEL_API RowRange rows(int height) const;
};

/// What a part's file says of the picture.
struct PartHeader {
  PartNumber part = {};
  int height = 0;                           ///< Rows of the picture.
  std::string made_by = {};                 ///< The same for all parts of one picture.
  std::vector<float> world_to_camera = {};  ///< As in ImageWriteOptions.
  std::vector<std::pair<std::string, std::string>> metadata = {};  ///< The picture's.
};

/// The part's rows of a picture.
SURFEL_API Image part_of(const Image& picture, const PartNumber& part);
/// How write_image() writes part_of() a picture of `height` rows as EXR, whose data window has the
/// part's rows, and whose display window is the picture.
/// \param made_by  what must be the same for all parts of one picture.
/// \param options  the picture's.
SURFEL_API ImageWriteOptions part_options(const PartNumber& part, int height,
                                          const std::string& made_by, ImageWriteOptions options);

/// Is there a file that holds this part, whole, and that was made so?
SURFEL_API bool part_is_there(const std::string& path, const PartNumber& part,
                              const std::string& made_by);

/// Joins the parts of a picture.
class SURFEL_API PictureJoin {
 public:
  /// Reads a part. Throws Error(kIo, kInput) naming the file: it cannot be read, is damaged, is no
  /// part of a picture, is a part of another picture than the parts before (another size, other
  /// channels, another camera, or made in another way), or the part was there before.
  void add(const std::string& path);

  /// Parts of the picture; 0 while there is none.
  int parts() const { return header_ ? header_->part.parts : 0; }
  /// The numbers of the parts that have not been added, ascending.
  std::vector<int> missing() const;
  /// What the files say of the picture; at least one part has been added.
  const PartHeader& header() const { return *header_; }
  /// The picture, once no part is missing.
  Image take() { return std::move(picture_); }

 private:
  std::optional<PartHeader> header_;
  std::vector<std::string> files_;  ///< By part; empty where it is missing.
  Image picture_;
};

}  // namespace surfel
