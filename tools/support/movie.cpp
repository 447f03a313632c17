#include "tools/support/movie.h"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/process.h>
#include <surfel/base/shell_quote.h>

namespace surfel::tool {
namespace {

namespace fs = std::filesystem;

/// What ffmpeg is told of a film's kind.
std::vector<std::string> encoder(const std::string& extension) {
  // 4:2:0 wants even sides; players assume the colours of BT.601 where a film does not say which it
  // has.
  const std::string even =
      "scale=out_color_matrix=bt709:out_range=tv,pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white";
  const std::vector<std::string> colors{"-pix_fmt",         "yuv420p", "-colorspace", "bt709",
                                        "-color_primaries", "bt709",   "-color_trc",  "bt709"};
  std::vector<std::string> words;
  if (extension == ".gif") {
    words = {"-vf", "split[a][b];[a]palettegen[p];[b][p]paletteuse", "-loop", "0"};
  } else if (extension == ".webp") {
    words = {"-c:v", "libwebp_anim", "-quality", "90", "-loop", "0"};
  } else if (extension == ".webm") {
    words = {"-vf", even, "-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0"};
    words.insert(words.end(), colors.begin(), colors.end());
  } else {
    words = {"-vf", even, "-c:v", "libx264", "-crf", "18", "-movflags", "+faststart"};
    words.insert(words.end(), colors.begin(), colors.end());
  }
  // The same pictures give the same bytes: no dates, no versions, as many threads everywhere.
  words.insert(words.end(), {"-threads", "2", "-fflags", "+bitexact", "-flags:v", "+bitexact"});
  return words;
}

/// A new folder beside the film, for as long as it is made.
std::string temporary_folder(const std::string& film) {
  const fs::path path(film);
  std::string pattern =
      (path.parent_path() / ("." + path.filename().string() + ".frames-XXXXXX")).string();
  if (!mkdtemp(pattern.data())) {
    throw_io(film, std::string("no folder can be made beside it: ") + std::strerror(errno));
  }
  return pattern;
}

}  // namespace

bool is_film_name(const std::string& path) {
  const std::string extension = lower_extension(path);
  return extension == ".mp4" || extension == ".webm" || extension == ".gif";
}

Movie::Movie(std::string film, double pictures_a_second, bool no_clobber, std::string extension)
    : film_(std::move(film)),
      pictures_a_second_(pictures_a_second),
      no_clobber_(no_clobber),
      extension_(std::move(extension)),
      ffmpeg_(find_program("ffmpeg")) {
  // Before the work, so that a film that cannot be written is found at once.
  const OutputFile film_file(film_, no_clobber);
  if (!ffmpeg_.empty()) {
    folder_ = temporary_folder(film_);
    return;
  }
  folder_ = fs::path(film_).replace_extension("").string() + "_frames";
  std::error_code error;
  fs::create_directory(folder_, error);
  if (error) throw_io(folder_, "cannot be made: " + error.message());
}

Movie::~Movie() {
  std::error_code ignored;
  if (!ffmpeg_.empty()) fs::remove_all(folder_, ignored);
}

void Movie::take(const std::vector<std::string>& pictures) {
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    std::error_code error;
    const fs::path link = fs::path(folder_) / fmt::format("{:06}{}", i, extension_);
    fs::create_symlink(fs::absolute(pictures[i]), link, error);
    if (error) throw_io(link.string(), "cannot be made: " + error.message());
  }
}

std::vector<std::string> Movie::command(const std::string& pictures,
                                        const std::string& film) const {
  std::vector<std::string> words{"ffmpeg", "-y",         "-loglevel",
                                 "error",  "-framerate", fmt::format("{}", pictures_a_second_),
                                 "-i",     pictures};
  for (std::string& word : encoder(lower_extension(film_))) words.push_back(std::move(word));
  words.push_back(film);
  return words;
}

void Movie::join() {
  if (ffmpeg_.empty()) {
    throw_io(film_, fmt::format("ffmpeg, which joins pictures, is not installed; they are in {}, "
                                "and this joins them: {}",
                                folder_, shell_command(command(pattern(), film_))));
  }
  OutputFile film(film_, no_clobber_);
  std::vector<std::string> words = command(names(), fs::absolute(film.temporary()).string());
  words[0] = ffmpeg_;
  const ProcessResult result = run_process(words, folder_);
  if (result.exit_code != 0) {
    throw_io(film_, "ffmpeg cannot make it of the pictures: " +
                        result.errors.substr(0, result.errors.find_last_not_of('\n') + 1));
  }
  film.commit();
}

}  // namespace surfel::tool
