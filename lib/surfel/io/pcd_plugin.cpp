// Plug-in libsurfel_pcd.so: the one place that sees PCL's files library, which takes long to load.

#include <exception>
#include <mutex>
#include <sstream>
#include <string>

#include <pcl/PCLPointCloud2.h>
#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>
#include <surfel/base/export.h>
#include <surfel/io/pcd_plugin.h>

namespace {

/// Silences PCL, whose messages go to the terminal, and gives its verbosity, one for the whole
/// process, back to the program that set it.
class Silence {
 public:
  Silence() : lock_(mutex()), before_(pcl::console::getVerbosityLevel()) {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  }
  ~Silence() { pcl::console::setVerbosityLevel(before_); }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  static std::mutex& mutex() {
    static std::mutex one;
    return one;
  }
  std::lock_guard<std::mutex> lock_;
  pcl::console::VERBOSITY_LEVEL before_;
};

}  // namespace

extern "C" SURFEL_API bool surfel_pcd_decompress(surfel::PcdDecompression& work);

/// PCL reports by printing, by throwing and by return value; all three become false.
extern "C" bool surfel_pcd_decompress(surfel::PcdDecompression& work) {
  const Silence silence;
  try {
    std::istringstream header(
        std::string(reinterpret_cast<const char*>(work.file), work.header_size));
    pcl::PCDReader reader;
    pcl::PCLPointCloud2 cloud;
    Eigen::Vector4f origin;
    Eigen::Quaternionf orientation;
    int version = 0;
    int data_type = 0;
    unsigned int data_begin = 0;
    constexpr int kCompressed = 2;  // PCL's number of binary_compressed.
    if (reader.readHeader(header, cloud, origin, orientation, version, data_type, data_begin) < 0 ||
        data_type != kCompressed || data_begin != work.header_size ||
        reader.readBodyBinary(work.file, cloud, version, true, data_begin) < 0) {
      return false;
    }
    work.records = std::move(cloud.data);
    work.stride = cloud.point_step;
    return true;
  } catch (const std::exception&) {
    return false;
  }
}
