#pragma once

#include <string>

#include <png.h>

namespace surfel {

/// The handlers of libpng's errors and warnings, and the message of the last error. Whoever calls
/// libpng sets a jump before, since the handler jumps there. Internal to the io module.
struct PngErrors {
  std::string message;

  static void fail(png_structp png, png_const_charp message) {
    static_cast<PngErrors*>(png_get_error_ptr(png))->message = message;
    png_longjmp(png, 1);
  }
  static void ignore(png_structp /*png*/, png_const_charp /*message*/) {}
};

}  // namespace surfel
