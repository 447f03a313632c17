#include <algorithm>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/io/decompression.h>
#include <surfel/io/input_file.h>
#include <zlib.h>
#include <zstd.h>

namespace surfel {
namespace {

/// Memory for what is decompressed, unless it is more than there is.
Array<std::byte> room_for(std::size_t size, const std::string& file) {
  if (size > available_memory_for(size)) {
    throw_input(file, fmt::format("its decompressed content, {} MB, is too large for this "
                                  "machine's memory",
                                  size >> 20));
  }
  return Array<std::byte>(size);
}

/// A decoder of zlib, freed with the scope.
struct Inflater {
  z_stream stream{};
  int state;
  Inflater() {
    constexpr int kGzipOrZlib = 32;
    state = inflateInit2(&stream, kGzipOrZlib + MAX_WBITS);
  }
  ~Inflater() { inflateEnd(&stream); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;
};

}  // namespace

Array<std::byte> gunzip(std::span<const std::byte> data, std::size_t size, const std::string& file,
                        bool more) {
  Array<std::byte> out = room_for(size, file);
  Inflater inflater;
  z_stream& z = inflater.stream;
  // zlib counts in 32 bits.
  constexpr std::size_t kAtOnce = std::numeric_limits<uInt>::max();
  std::size_t taken = 0;
  std::size_t made = 0;
  int state = inflater.state;
  while (state == Z_OK) {
    const bool full = made == size;
    if (full && more) return out;
    Bytef surplus = 0;  // The room for a byte too many.
    const std::size_t in = std::min(kAtOnce, data.size() - taken);
    const std::size_t room = full ? 1 : std::min(kAtOnce, size - made);
    // zlib's interface takes no pointers to constants, but does not write to its input.
    z.next_in = const_cast<Bytef*>(reinterpret_cast<const Bytef*>(data.data() + taken));
    z.avail_in = static_cast<uInt>(in);
    z.next_out = full ? &surplus : reinterpret_cast<Bytef*>(out.data() + made);
    z.avail_out = static_cast<uInt>(room);
    state = inflate(&z, Z_NO_FLUSH);
    taken += in - z.avail_in;
    made += room - z.avail_out;
    if (made > size) {
      throw_input(file, fmt::format("its compressed data holds more than the {} bytes that its "
                                    "header promises; it is damaged or its header is wrong",
                                    size));
    }
    const bool member = as_text(data.subspan(taken)).starts_with(kGzipMagic);
    if (state == Z_STREAM_END && member) state = inflateReset(&z);
  }
  if (state == Z_BUF_ERROR) {
    throw_input(file, "ends within its compressed data; it is truncated");
  }
  if (state != Z_STREAM_END) {
    throw_input(file, fmt::format("its compressed data is damaged ({})", z.msg ? z.msg : "zlib"));
  }
  if (made < size) {
    throw_input(file, fmt::format("its compressed data ends after {} of {} bytes; it is truncated "
                                  "or its header is wrong",
                                  made, size));
  }
  // Zeros fill up blocks of tapes and disks, as gzip has it.
  if (as_text(data.subspan(taken)).find_first_not_of('\0') != std::string_view::npos && !more) {
    throw_input(file,
                "its compressed data is followed by bytes that are none of it; it is damaged "
                "or two files are joined");
  }
  return out;
}

Array<std::byte> unzstd(std::span<const std::byte> data, std::size_t size,
                        const std::string& file) {
  Array<std::byte> out = room_for(size, file);
  const std::size_t made = ZSTD_decompress(out.data(), size, data.data(), data.size());
  if (ZSTD_isError(made) != 0) {
    throw_input(file, fmt::format("its compressed data is damaged ({})", ZSTD_getErrorName(made)));
  }
  if (made != size) {
    throw_input(file,
                fmt::format("a stream holds {} bytes and promises {}; it is damaged", made, size));
  }
  return out;
}

}  // namespace surfel
