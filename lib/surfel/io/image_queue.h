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
/// picture of a sequence is made while one is encoded. The files have the bytes that write_image()
/// writes.
class SURFEL_API ImageQueue {
 public:
  /// At most `waiting` images wait beside the one that is being written. If `waiting` is 0, or
  /// thread_count() is 1, write() writes the image before it returns.
  explicit ImageQueue(std::size_t waiting);
  /// Images that still wait are not written.
  ~ImageQueue();
  ImageQueue(const ImageQueue&) = delete;
  ImageQueue& operator=(const ImageQueue&) = delete;

  /// Takes an image; waits while the queue is full. Throws the error that write_image() threw for
  /// this image or an earlier one; no image is written after an error.
  void write(Image image, std::string path, ImageWriteOptions options);
  /// Waits until all are written. Throws as write() does.
  void finish();
  /// Time to encode and write each image, in the order of the images; call it after finish().
  const std::vector<double>& milliseconds() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
