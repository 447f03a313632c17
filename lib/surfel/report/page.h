#pragma once

// What the pages of all reports are made of: one style, one way to escape, pictures within the
// page.

#include <map>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/image.h>

namespace surfel {

/// Bytes that are not UTF-8 replaced, so that the text can stand in a page and in JSON.
SURFEL_API std::string valid_utf8(const std::string& text);

/// Text for HTML: < > & " ' escaped, bytes that are not UTF-8 replaced.
SURFEL_API std::string escape_html(const std::string& text);

/// Standard base 64, padded.
SURFEL_API std::string base64(const std::string& bytes);

/// A page that needs nothing else, for screens of any width, light or dark. Members named `_html`
/// are HTML, all others plain text.
struct Page {
  std::string title;     ///< Of the window.
  std::string heading;   ///< Above the page.
  std::string subtitle;  ///< What it is of, and by which tool.
  std::string body_html;
  std::string script;  ///< JavaScript to be run at the end; empty: none.
};
SURFEL_API std::string page_html(const Page& page);

/// Facts by name, as a table of two columns.
SURFEL_API std::string facts_html(const std::vector<std::pair<std::string, std::string>>& facts);

/// A picture, a chart or the like with a caption.
/// \param kind          Classes of the style sheet, or empty.
/// \param content_html  The picture or the chart, as HTML.
/// \param caption_html  The caption, as HTML.
/// \return A `figure` element.
SURFEL_API std::string figure_html(const std::string& kind, const std::string& content_html,
                                   const std::string& caption_html);

/// Text that can be copied, such as a command.
SURFEL_API std::string pre_html(const std::string& text);

/// Pictures of a page, each of them in it once.
class SURFEL_API PagePictures {
 public:
  /// A picture as PNG, as write_image() writes it.
  std::string add(const Image& image);
  /// A picture whose PNG file has these bytes.
  /// \param png    Bytes of a PNG file.
  /// \param image  The same, for its size.
  std::string add(const std::string& png, const Image& image);

 private:
  /// By content, where its bytes are in the page.
  std::map<std::string, std::string> known_;
};

}  // namespace surfel
