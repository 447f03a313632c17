#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include <surfel/base/parallel.h>
#include <surfel/base/timing.h>
#include <surfel/io/image_io.h>
#include <surfel/io/image_queue.h>

namespace surfel {

struct ImageQueue::Impl {
  struct Job {
    Image image;
    std::string path;
    ImageWriteOptions options;
  };

  std::size_t waiting;
  std::vector<double> milliseconds;
  std::deque<Job> jobs;
  bool busy = false;   ///< An image is being written.
  bool ended = false;  ///< The thread is to end.
  std::exception_ptr error;
  std::mutex mutex;
  std::condition_variable changed;
  std::thread thread;

  void run();
  void rethrow() const {
    if (error) std::rethrow_exception(error);
  }
};

namespace {

double write_timed(const Image& image, const std::string& path, const ImageWriteOptions& options) {
  const Timer timer;
  write_image(image, path, options);
  return timer.milliseconds();
}

}  // namespace

void ImageQueue::Impl::run() {
  const SerialLoops alone;  // The cores are busy with the next picture.
  std::unique_lock lock(mutex);
  for (;;) {
    changed.wait(lock, [&] { return ended || !jobs.empty(); });
    if (ended) return;
    const Job job = std::move(jobs.front());
    jobs.pop_front();
    busy = true;
    lock.unlock();
    double taken = 0;
    std::exception_ptr failure;
    try {
      taken = write_timed(job.image, job.path, job.options);
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    busy = false;
    if (failure) {
      error = failure;
      jobs.clear();
      ended = true;
    } else {
      milliseconds.push_back(taken);
    }
    changed.notify_all();
  }
}

ImageQueue::ImageQueue(std::size_t waiting) : impl_(std::make_unique<Impl>()) {
  impl_->waiting = thread_count() > 1 ? waiting : 0;
  if (impl_->waiting == 0) return;
  try {
    impl_->thread = std::thread([this] { impl_->run(); });
  } catch (const std::system_error&) {
    impl_->waiting = 0;  // Where no thread can be started, write() does the work.
  }
}

ImageQueue::~ImageQueue() {
  if (!impl_->thread.joinable()) return;
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->ended = true;
  }
  impl_->changed.notify_all();
  impl_->thread.join();
}

void ImageQueue::write(Image image, std::string path, ImageWriteOptions options) {
  if (impl_->waiting == 0) {
    impl_->milliseconds.push_back(write_timed(image, path, options));
    return;
  }
  std::unique_lock lock(impl_->mutex);
  impl_->changed.wait(lock, [&] { return impl_->error || impl_->jobs.size() < impl_->waiting; });
  impl_->rethrow();
  impl_->jobs.push_back({std::move(image), std::move(path), std::move(options)});
  impl_->changed.notify_all();
}

void ImageQueue::finish() {
  std::unique_lock lock(impl_->mutex);
  impl_->changed.wait(lock, [&] { return impl_->error || (impl_->jobs.empty() && !impl_->busy); });
  impl_->rethrow();
}

const std::vector<double>& ImageQueue::milliseconds() const { return impl_->milliseconds; }

}  // namespace surfel
