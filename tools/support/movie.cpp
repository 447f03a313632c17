#include "tools/support/movie.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/process.h>
#include <surfel/base/shell_quote.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

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

/// What names of temporary folders end with, of which the placeholders become letters.
constexpr std::string_view kMark = ".frames-XXXXXX";

/// Opens a folder and locks it, as long as it is open; -1, and errno, where another process has
/// (EWOULDBLOCK), where it is none (ENOENT), or where the disk knows no locks.
int lock_folder(const std::string& folder) {
  const int opened = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (opened < 0 || flock(opened, LOCK_EX | LOCK_NB) == 0) return opened;
  const int error = errno;
  close(opened);
  errno = error;
  return -1;
}

/// Removes temporary folders of processes that were killed.
void remove_abandoned(const fs::path& beside) {
  std::error_code ignored;
  for (fs::directory_iterator at(beside.empty() ? "." : beside, ignored), end; at != end;
       at.increment(ignored)) {
    const std::string name = at->path().filename().string();
    const std::size_t mark = name.size() - std::min(name.size(), kMark.size());
    const std::string_view fixed = kMark.substr(0, kMark.find('X'));
    if (mark == 0 || name.front() != '.' || !name.substr(mark).starts_with(fixed)) continue;
    const int lock = lock_folder(at->path().string());
    if (lock < 0) continue;
    fs::remove_all(at->path(), ignored);
    close(lock);
  }
}

/// Makes a new folder beside the film, for as long as it is made, and locks it.
std::string temporary_folder(const std::string& film, int& lock) {
  const fs::path path(film);
  remove_abandoned(path.parent_path());
  // Another process may take a folder for an abandoned one before it is locked: it holds the lock,
  // or has removed the folder.
  constexpr int kMostTries = 100;
  for (int i = 0; i < kMostTries; ++i) {
    std::string pattern =
        (path.parent_path() / ("." + path.filename().string() + std::string(kMark))).string();
    if (!mkdtemp(pattern.data())) {
      throw_io(film, std::string("no folder can be made beside it: ") + std::strerror(errno));
    }
    lock = lock_folder(pattern);
    if (lock < 0 && errno != EWOULDBLOCK && errno != ENOENT) return pattern;
    struct stat status {};
    if (lock >= 0 && fstat(lock, &status) == 0 && status.st_nlink > 0) return pattern;
    if (lock >= 0) close(lock);
  }
  throw_io(film, "no folder can be made beside it: other processes remove it");
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
    folder_ = temporary_folder(film_, lock_);
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
  if (lock_ >= 0) close(lock_);
}

void Movie::take(const std::vector<std::string>& pictures) {
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    std::error_code error;
    const fs::path link = fs::path(folder_) / fmt::format("{:06}{}", i, extension_);
    fs::create_symlink(fs::absolute(pictures[i]), link, error);
    if (error) throw_io(link.string(), "cannot be made: " + error.message());
  }
}

std::vector<std::string> Movie::command(const std::string& pictures, const std::string& film,
                                        const std::string& comment) const {
  std::vector<std::string> words{"ffmpeg", "-y",         "-loglevel",
                                 "error",  "-framerate", fmt::format("{}", pictures_a_second_),
                                 "-i",     pictures};
  for (std::string& word : encoder(lower_extension(film_))) words.push_back(std::move(word));
  if (!comment.empty()) words.insert(words.end(), {"-metadata", "comment=" + comment});
  words.push_back(film);
  return words;
}

void Movie::join(const std::string& comment) {
  if (ffmpeg_.empty()) {
    throw_io(film_,
             fmt::format("ffmpeg, which joins pictures, is not installed; they are in {}, "
                         "and this joins them: {}",
                         folder_,
                         shell_command(command(
                             pattern(), film_.starts_with('-') ? "./" + film_ : film_, comment))));
  }
  OutputFile film(film_, no_clobber_);
  std::vector<std::string> words =
      command(names(), fs::absolute(film.temporary()).string(), comment);
  words[0] = ffmpeg_;
  const ProcessResult result = run_process(words, folder_);
  if (result.exit_code != 0) {
    throw_io(film_, "ffmpeg cannot make it of the pictures: " +
                        result.errors.substr(0, result.errors.find_last_not_of('\n') + 1));
  }
  film.commit();
}

}  // namespace surfel::tool
