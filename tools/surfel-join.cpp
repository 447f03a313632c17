// surfel-join: one picture of the parts that surfel-render --tiles makes, or a film of pictures.

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/io/picture_part.h>

#include "tools/support/movie.h"
#include "tools/support/tool.h"

namespace {

using surfel::tool::Tool;

struct Settings {
  std::vector<std::string> files;
  std::string output;
  bool missing = false;
  double fps = 30;  ///< Pictures a second of films.
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
  for (const std::string& path : s.files) {
    try {
      join.add(path);
    } catch (const surfel::Error& error) {
      failures.emplace_back(error.what());
    }
  }
  if (join.parts() == 0) throw surfel::Error(surfel::ErrorKind::kInput, failures.front());
  return join;
}

/// Missing parts that messages name.
constexpr std::size_t kMostNamed = 8;

void print_missing(const Tool& tool, const surfel::PictureJoin& join,
                   const std::vector<std::string>& failures) {
  for (const std::string& failure : failures) tool.note(failure);
  const std::vector<int> missing = join.missing();
  if (!missing.empty()) surfel::tool::print(fmt::format("{}\n", fmt::join(missing, ",")));
}

void write_picture(const Tool& tool, const Settings& s, surfel::PictureJoin& join,
                   std::vector<std::string> failures) {
  const surfel::PartHeader& header = join.header();
  const std::vector<int> missing = join.missing();
  for (std::size_t i = 0; i < std::min(missing.size(), kMostNamed); ++i) {
    failures.push_back("there is no part " + named_part(missing[i], header));
  }
  if (missing.size() > kMostNamed) {
    failures.push_back(fmt::format("{} more are missing", missing.size() - kMostNamed));
  }
  if (!failures.empty()) {
    surfel::throw_input(
        s.output,
        fmt::format("cannot be made: {}; make what is missing as the others were made ({}), with "
                    "--tiles I/{}, and leave out what is no part",
                    fmt::join(failures, "; "), header.made_by, header.part.parts));
  }
  surfel::Image picture = join.take();
  if (!surfel::image_format_has_alpha(s.output)) composite_over_white(picture);
  surfel::write_image(picture, s.output,
                      {.no_clobber = tool.common().no_clobber,
                       .metadata = header.metadata,
                       .world_to_camera = header.world_to_camera});
  tool.wrote(s.output,
             fmt::format("{}x{} pixels of {} parts", picture.width, picture.height, join.parts()));
}

void write_film(const Tool& tool, const Settings& s) {
  const std::string extension = surfel::tool::lower_extension(s.files.front());
  const surfel::ImageReader::Layout first = surfel::open_image(s.files.front())->layout();
  for (const std::string& file : s.files) {
    const surfel::ImageReader::Layout layout = surfel::open_image(file)->layout();
    if (surfel::tool::lower_extension(file) != extension || layout.width != first.width ||
        layout.height != first.height) {
      surfel::throw_input(
          file,
          fmt::format("is a picture of {}x{} pixels, and {} one of {}x{}; join pictures of "
                      "one size and one format",
                      layout.width, layout.height, s.files.front(), first.width, first.height));
    }
  }
  surfel::tool::Movie movie(s.output, s.fps, tool.common().no_clobber, extension);
  movie.take(s.files);
  movie.join();
  tool.wrote(s.output, fmt::format("film of {} pictures", s.files.size()));
}

}  // namespace

int main(int argc, char** argv) {
  Tool tool(
      "surfel-join",
      "Joins the parts of a picture that surfel-render --tiles makes, or pictures to a film.");
  Settings s;
  tool.app()
      .add_option("files", s.files,
                  "Parts of one picture (EXR), in any order, or pictures of a film, in their order")
      ->required();
  tool.app().add_option("-o,--output", s.output,
                        "Picture (EXR, PNG, TIFF, JPEG, ...), or film (MP4, WebM, GIF; ffmpeg "
                        "makes it)");
  tool.app().add_flag("--missing", s.missing,
                      "Print the numbers of the parts that are not there or are damaged, such as "
                      "2,5, instead of joining them; nothing where all are there");
  tool.app().add_option("--fps", s.fps, "Pictures a second of films, 0.1..1000");
  tool.everyday({"--output", "--missing", "--fps"},
                {"surfel-join part_*.exr -o lion.png", "surfel-join --missing part_*.exr",
                 "surfel-join lion_*.png -o lion.mp4 --fps 25"});
  tool.reads_images();
  tool.files().reads({"files"});
  tool.files().writes("--output", surfel::tool::Writes::kFilm);
  return tool.run(argc, argv, [&] {
    if (s.missing == !s.output.empty()) {
      surfel::throw_usage("give either --output or --missing");
    }
    if (!(s.fps >= 0.1 && s.fps <= 1000)) {
      surfel::throw_usage(fmt::format("--fps is {:g}; it must be in 0.1..1000", s.fps));
    }
    if (surfel::tool::is_film_name(s.output)) {
      write_film(tool, s);
      return;
    }
    surfel::tool::require_valid(surfel::tool::without_effect(tool.app(), {"--fps"}, "on pictures"));
    std::vector<std::string> failures;
    surfel::PictureJoin join = read_parts(s, failures);
    tool.report()["parts"] = join.parts();
    tool.report()["missing"] = join.missing();
    if (s.missing) {
      print_missing(tool, join, failures);
    } else {
      write_picture(tool, s, join, failures);
    }
  });
}
