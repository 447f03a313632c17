// surfel-join: one picture of the parts that surfel-render --tiles makes, or a film of pictures.

#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/io/picture_part.h>
#include <surfel/render/a_buffer.h>

#include "tools/support/tool.h"

namespace {

using surfel::tool::Tool;

struct Settings {
  std::vector<std::string> parts;
  std::string output;
  bool missing = false;
};

/// Formats without alpha get the picture over white, as surfel-render draws it for them.
void composite_over_white(surfel::Image& picture) {
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      float* const pixel = picture.pixel(x, y);
      for (int c = 0; c < 3; ++c) pixel[c] += 1 - pixel[3];
      pixel[3] = 1;
    }
  }
}

/// "3 of 8 (rows 128 to 191)".
std::string named_part(int number, const surfel::PartHeader& header) {
  const surfel::RowRange rows = surfel::PartNumber{number, header.part.parts}.rows(header.height);
  return fmt::format("{} of {} (rows {} to {})", number, header.part.parts, rows.begin,
                     rows.end - 1);
}

/// Reads the parts that can be read; `failures` are the messages of the others.
surfel::PictureJoin read_parts(const Settings& s, std::vector<std::string>& failures) {
  surfel::PictureJoin join;
  for (const std::string& path : s.parts) {
    try {
      join.add(path);
    } catch (const surfel::Error& error) {
      failures.emplace_back(error.what());
    }
  }
  if (join.parts() == 0) surfel::throw_input(s.parts.front(), failures.front());
  return join;
}

}  // namespace

int main(int argc, char** argv) {
  Tool tool("surfel-join", "Joins the parts of a picture that surfel-render --tiles makes.");
  Settings s;
  tool.app().add_option("parts", s.parts, "Parts of one picture, in any order (EXR)")->required();
  tool.app().add_option("-o,--output", s.output, "Picture (EXR, PNG, TIFF, JPEG, ...)");
  tool.app().add_flag("--missing", s.missing,
                      "Print the numbers of the parts that are not there or are damaged, such as "
                      "2,5, instead of joining them; nothing where all are there");
  tool.everyday({"--output", "--missing"},
                {"surfel-join part_*.exr -o lion.png", "surfel-join --missing part_*.exr"});
  tool.reads_images();
  tool.files().reads({"parts"});
  tool.files().writes("--output", surfel::tool::Writes::kPicture);
  return tool.run(argc, argv, [&] {
    if (s.missing == !s.output.empty()) {
      surfel::throw_usage("give either --output, the picture, or --missing");
    }
    std::vector<std::string> failures;
    surfel::PictureJoin join = read_parts(s, failures);
    const std::vector<int> missing = join.missing();
    tool.report()["parts"] = join.parts();
    tool.report()["missing"] = missing;
    if (s.missing) {
      for (const std::string& failure : failures) tool.note(failure);
      if (!missing.empty()) surfel::tool::print(fmt::format("{}\n", fmt::join(missing, ",")));
      return;
    }
    const surfel::PartHeader& header = join.header();
    for (const int number : missing)
      failures.push_back("there is no part " + named_part(number, header));
    if (!failures.empty()) {
      surfel::throw_input(
          s.parts.front(),
          fmt::format("the picture is not whole: {}; make them by {} --tiles=I/{}",
                      fmt::join(failures, "; "), header.made_by, header.part.parts));
    }
    surfel::Image picture = join.take();
    if (!surfel::image_format_has_alpha(s.output)) composite_over_white(picture);
    surfel::write_image(picture, s.output,
                        {.no_clobber = tool.common().no_clobber,
                         .metadata = header.metadata,
                         .world_to_camera = header.world_to_camera});
    tool.wrote(s.output, fmt::format("{}x{} pixels of {} parts", picture.width, picture.height,
                                     join.parts()));
  });
}
