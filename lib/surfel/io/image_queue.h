#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>

namespace surfel {

/// Writes images in the order in which they are given, by a thread of its own, so that the next
/// picture of a sequence is made while one is encoded. The same bytes as of write_image().
class SURFEL_API ImageQueue {
 public:
  /// At most `waiting` images wait beside the one that is being written; with 0, or with one thread
  /// (thread_count()), write() itself writes.
  explicit ImageQueue(std::size_t waiting);
  /// Images that still wait are not written.
  ~ImageQueue();
  ImageQueue(const ImageQueue&) = delete;
  ImageQueue& operator=(const ImageQueue&) = delete;

  /// Takes an image; waits while the queue is full. Throws what write_image() threw for this image
  /// or an earlier one; nothing is written after that.
  void write(Image image, std::string path, ImageWriteOptions options);
  /// Waits until all are written. Throws as write() does.
  void finish();
  /// What each image took to be encoded and written; after finish().
  const std::vector<double>& milliseconds() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
