#pragma once

#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/image.h>
#include <surfel/truth/image_error.h>

namespace surfel {

/// What a page tells of a picture beside the true one. All texts are plain.
struct ComparePage {
  std::string tested, truth;                                 ///< Names.
  std::vector<std::pair<std::string, std::string>> figures;  ///< The measures.
  std::vector<std::string> missed;  ///< Limits that are not met, a sentence each.
  bool limited = false;             ///< There are limits.
  double scale = 10;                ///< Factor of the picture of differences, > 0.
  std::string command;              ///< The command that made the page.
};

/// One page that needs nothing else: a slider between the pictures, their difference, a map of the
/// errors with its scale, how many pixels differ by how much, and the measures. The same for the
/// same input. Throws as image_error() does.
SURFEL_API std::string compare_page_html(const ComparePage& page, const Image& tested,
                                         const Image& truth, const ImageErrorOptions& options);

}  // namespace surfel
