#pragma once

#include <string>
#include <vector>

#include "tools/support/tool.h"

namespace surfel::tool {

/// Is this the name of a film, which several pictures become: .mp4, .webm, .gif?
bool is_film_name(const std::string& path);

/// The pictures of a film, and the film that ffmpeg makes of them. The pictures lie in a folder of
/// their own beside it, which is removed with this object; without ffmpeg it is kept.
/// Folders of processes that were killed are removed by the next that makes a film beside them.
class Movie {
 public:
  /// Throws Error(kIo) where the film or the folder cannot be written.
  /// \param extension  of the pictures' names.
  Movie(std::string film, double pictures_a_second, bool no_clobber,
        std::string extension = ".png");
  ~Movie();
  Movie(const Movie&) = delete;
  Movie& operator=(const Movie&) = delete;

  /// Pattern of the pictures' names, for numbers from 0 on.
  std::string pattern() const { return folder_ + "/" + names(); }
  /// Takes pictures that are there already, in this order. Throws Error(kIo) where it cannot.
  void take(const std::vector<std::string>& pictures);
  /// Joins the pictures, all of which have been written. Throws Error(kIo) with what ffmpeg says,
  /// or, where there is none, with the command that joins them.
  /// \param comment  A text that MP4 and WebM hold as it is; empty: none.
  void join(const std::string& comment = {});

 private:
  std::string names() const { return "%06d" + extension_; }
  std::vector<std::string> command(const std::string& pictures, const std::string& film,
                                   const std::string& comment) const;

  std::string film_;
  double pictures_a_second_;
  bool no_clobber_;
  std::string extension_;
  std::string ffmpeg_;  ///< Empty if there is none.
  std::string folder_;
  int lock_ = -1;  ///< The open folder where it is temporary; -1: there is no lock.
};

}  // namespace surfel::tool
