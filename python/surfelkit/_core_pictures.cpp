// Cameras, pictures and renderers.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <mutex>

#include <surfel/base/color.h>
#include <surfel/gaussian/gaussian_extent.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/io/scene_file.h>
#include <surfel/measure/view_guess.h>
#include <surfel/render/environment_map.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/view.h>
#include <surfel/store/cloud_loader.h>
#include <surfel/truth/image_error.h>

#include "_pictures.h"

namespace surfel::python {
namespace {

/// A camera, and what is up for it, which the light of the sky heeds.
struct ViewCamera {
  Camera camera;
  Vec3d up;
};

// Cameras.

template <class Matrix>
Matrix matrix_of(const py::object& given, const std::string& name) {
  const py::array values = values_of(given, py::dtype::of<double>(),
                                     {Matrix::RowsAtCompileTime, Matrix::ColsAtCompileTime}, name);
  using Rows =
      Eigen::Matrix<double, Matrix::RowsAtCompileTime, Matrix::ColsAtCompileTime, Eigen::RowMajor>;
  return Eigen::Map<const Rows>(static_cast<const double*>(values.data()));
}

using Mat4d = Eigen::Matrix<double, 4, 4, Eigen::DontAlign>;

template <class Matrix>
py::array array_of(const Matrix& matrix) {
  py::array_t<double> out(std::vector<py::ssize_t>{matrix.rows(), matrix.cols()});
  for (Eigen::Index row = 0; row < matrix.rows(); ++row) {
    for (Eigen::Index column = 0; column < matrix.cols(); ++column) {
      out.mutable_at(row, column) = matrix(row, column);
    }
  }
  return out;
}

ViewCamera camera_of(const std::array<int, 2>& size, const py::object& intrinsics,
                     const py::object& matrix, bool orthographic, double near) {
  const auto k = matrix_of<Eigen::Matrix3d>(intrinsics, "intrinsics");
  const auto m = matrix_of<Mat4d>(matrix, "matrix");
  const Eigen::Matrix3d rotation = m.topLeftCorner<3, 3>();
  constexpr double kTolerance = 1e-3;
  if (!(rotation * rotation.transpose()).isIdentity(kTolerance) || rotation.determinant() < 0) {
    throw_usage("`matrix` must take the world to the camera by a rotation and a translation");
  }
  // A camera has no place for skew or another last row: both are refused, but for rounding.
  constexpr double kRounding = 1e-9;
  if (!((m.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).array().abs() <= kRounding).all()) {
    throw_usage("the last row of `matrix` must be 0, 0, 0, 1");
  }
  Eigen::Matrix3d plain;
  plain << k(0, 0), 0, k(0, 2), 0, k(1, 1), k(1, 2), 0, 0, 1;
  if (!((k - plain).array().abs() <= kRounding * k.cwiseAbs().maxCoeff()).all()) {
    throw_usage(
        "`intrinsics` must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: skew is not drawn; undistort "
        "the pictures first");
  }
  Camera camera;
  camera.camera_from_world = rotation;
  camera.eye = -rotation.transpose() * m.topRightCorner<3, 1>();
  camera.width = size[0];
  camera.height = size[1];
  camera.focal_x = k(0, 0);
  camera.focal_y = k(1, 1);
  camera.center_x = k(0, 2);
  camera.center_y = k(1, 2);
  camera.orthographic = orthographic;
  camera.near = near;
  if (const std::vector<std::string> problems = camera.problems(); !problems.empty()) {
    throw_usage(problems.front());
  }
  return {camera, mean_up({View{"", camera}})};
}

void bind_camera(py::module_& module) {
  py::class_<ViewCamera>(
      module, "Camera",
      "A pinhole or orthographic camera: x right, y down, z forward; pixel centres at +0.5.")
      .def(py::init(&camera_of), py::arg("size"), py::arg("intrinsics"), py::arg("matrix"),
           py::kw_only(), py::arg("orthographic") = Camera().orthographic,
           py::arg("near") = Camera().near,
           "size: (width, height), pixels.\n"
           "intrinsics: (3, 3): focal lengths and principal point, pixels; of orthographic\n"
           "    cameras pixels by scene unit.\n"
           "    Skew is refused.\n"
           "matrix: (4, 4), world to camera, a rotation and a translation.\n"
           "near: nothing nearer along z is drawn, scene units.\n\n"
           "Raises UsageError where this is no camera.")
      .def_property_readonly(
          "size",
          [](const ViewCamera& c) { return py::make_tuple(c.camera.width, c.camera.height); },
          "(width, height), pixels.")
      .def_property_readonly(
          "intrinsics",
          [](const ViewCamera& c) {
            Eigen::Matrix3d k = Eigen::Matrix3d::Identity();
            k(0, 0) = c.camera.focal_x;
            k(1, 1) = c.camera.focal_y;
            k(0, 2) = c.camera.center_x;
            k(1, 2) = c.camera.center_y;
            return array_of(k);
          },
          "float64 (3, 3): focal lengths and principal point, pixels.")
      .def_property_readonly(
          "matrix",
          [](const ViewCamera& c) {
            Mat4d m = Mat4d::Identity();
            m.topLeftCorner<3, 3>() = c.camera.camera_from_world;
            m.topRightCorner<3, 1>() = -(c.camera.camera_from_world * c.camera.eye);
            return array_of(m);
          },
          "float64 (4, 4), world to camera.")
      .def_property_readonly(
          "eye",
          [](const ViewCamera& c) {
            return py::make_tuple(c.camera.eye.x(), c.camera.eye.y(), c.camera.eye.z());
          },
          "Place in world coordinates.")
      .def_property_readonly(
          "orthographic", [](const ViewCamera& c) { return c.camera.orthographic; },
          "Rays are parallel.")
      .def_property_readonly(
          "near", [](const ViewCamera& c) { return c.camera.near; },
          "Nothing nearer along z is drawn, scene units.")
      .def("__repr__", [](const ViewCamera& c) {
        return "<Camera of " + std::to_string(c.camera.width) + " x " +
               std::to_string(c.camera.height) + " pixels>";
      });
}

// Pictures.

py::array channels_of(const HeldPicture& picture, std::size_t first, std::size_t count) {
  Image& image = picture->image;
  const auto all = static_cast<py::ssize_t>(image.channels.size() * sizeof(float));
  std::vector<py::ssize_t> shape{image.height, image.width};
  std::vector<py::ssize_t> strides{all * image.width, all};
  if (count > 0) {
    shape.push_back(static_cast<py::ssize_t>(count));
    strides.push_back(sizeof(float));
  }
  return py::array(py::dtype::of<float>(), shape, strides, image.data.data() + first,
                   py::cast(picture));
}

std::optional<std::size_t> place_of(const Picture& picture, const std::string& channel) {
  const auto& names = picture.image.channels;
  const auto found = std::find(names.begin(), names.end(), channel);
  if (found == names.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names.begin());
}

/// The channel of that name; None where the picture has none.
py::object channel_or_none(const HeldPicture& picture, const std::string& name) {
  const std::optional<std::size_t> place = place_of(*picture, name);
  return place ? py::object(channels_of(picture, *place, 0)) : py::none();
}

/// Channels that follow one another in this order, or None.
py::object vectors_or_none(const HeldPicture& picture, const std::vector<std::string>& names) {
  const std::optional<std::size_t> place = place_of(*picture, names.front());
  const auto& all = picture->image.channels;
  if (!place || *place + names.size() > all.size()) return py::none();
  const bool follow =
      std::equal(names.begin(), names.end(), all.begin() + static_cast<std::ptrdiff_t>(*place));
  return follow ? py::object(channels_of(picture, *place, names.size())) : py::none();
}

py::object rgba_of(const HeldPicture& picture) {
  const py::object rgba = vectors_or_none(picture, {"R", "G", "B", "A"});
  if (rgba.is_none()) throw_input("", "the image has no channels R, G, B and A in this order");
  return rgba;
}

/// R G B A, linear, of an array (H, W), (H, W, 3) or (H, W, 4): floats as they are, or codes,
/// whose alpha is straight.
Image image_of(const py::object& given, bool premultiply) {
  const py::array array = as_array(given);
  const py::ssize_t channels = array.ndim() == 2 ? 1 : array.ndim() == 3 ? array.shape(2) : 0;
  if (channels != 1 && channels != 3 && channels != 4) {
    throw_input("", "an image has the shape " +
                        shape_text({array.shape(), array.shape() + array.ndim()}) +
                        "; it must be (H, W), (H, W, 3) or (H, W, 4)");
  }
  if (array.shape(0) < 1 || array.shape(1) < 1 || array.shape(0) > Camera::kMostSide ||
      array.shape(1) > Camera::kMostSide) {
    throw_input("", "an image must have 1 to 65536 pixels along each side");
  }
  const std::vector<py::ssize_t> shape(array.shape(), array.shape() + array.ndim());
  const py::array linear = linear_colors(array, shape, "image");
  const char kind = array.dtype().kind();
  Image image = rgba_image(static_cast<int>(array.shape(1)), static_cast<int>(array.shape(0)));
  const auto* from = static_cast<const float*>(linear.data());
  const std::size_t pixels = image.data.size() / 4;
  for (std::size_t i = 0; i < pixels; ++i, from += channels) {
    float* const to = image.data.data() + 4 * i;
    for (int c = 0; c < 3; ++c) to[c] = from[channels == 1 ? 0 : c];
    // Codes of alpha are no sRGB codes: it is decoded from its own array below.
    to[3] = channels == 4 ? from[3] : 1;
  }
  if (kind != 'u') return image;
  if (channels == 4) {
    const py::array codes = values_of(array, py::dtype::of<float>(), shape, "image");
    const float full = array.itemsize() == 1 ? 255.0F : 65535.0F;
    const auto* const code = static_cast<const float*>(codes.data());
    for (std::size_t i = 0; i < pixels; ++i) {
      float* const to = image.data.data() + 4 * i;
      to[3] = code[4 * i + 3] / full;
      for (int c = 0; c < 3 && premultiply; ++c) to[c] *= to[3];
    }
  }
  return image;
}

py::array codes_of(const Picture& picture) {
  const Image& image = picture.image;
  const std::optional<std::size_t> red = place_of(picture, "R");
  if (!red || *red + 3 > image.channels.size()) throw_input("", "the image has no R, G, B");
  const std::optional<std::size_t> alpha = place_of(picture, "A");
  py::array_t<std::uint8_t> out(std::vector<py::ssize_t>{image.height, image.width, 4});
  std::uint8_t* to = out.mutable_data();
  const std::size_t stride = image.channels.size();
  for (std::size_t i = 0; i < image.data.size(); i += stride, to += 4) {
    const float a = alpha ? std::clamp(image.data[i + *alpha], 0.0F, 1.0F) : 1.0F;
    for (std::size_t c = 0; c < 3; ++c) {
      to[c] = a > 0 ? linear_to_srgb8(image.data[i + *red + c] / a) : std::uint8_t{0};
    }
    to[3] = static_cast<std::uint8_t>(std::lround((std::isnan(a) ? 0.0F : a) * 255));
  }
  return out;
}

void bind_image(py::module_& module) {
  const auto view = [](const char* name) {
    return [name](const HeldPicture& self) { return channel_or_none(self, name); };
  };
  py::class_<Picture, HeldPicture>(
      module, "Image",
      "A picture: float32, linear light, premultiplied alpha, row 0 at the top. Its attributes\n"
      "are NumPy views of one memory; numpy.asarray(image) is `rgba`.")
      .def(py::init([](const py::object& array) {
             return std::make_shared<Picture>(Picture{image_of(array, true), std::nullopt});
           }),
           py::arg("array"),
           "array: (H, W), (H, W, 3) or (H, W, 4), which is copied. Floats are linear light,\n"
           "premultiplied; uint8 and uint16 are sRGB codes with straight alpha.\n\n"
           "Raises InputError for other shapes and types.")
      .def_property_readonly(
          "channels",
          [](const HeldPicture& self) { return py::tuple(py::cast(self->image.channels)); },
          "Names: R G B A, then of renderers Z, Z.first, N.X, N.Y, N.Z and weight.")
      .def_property_readonly(
          "data",
          [](const HeldPicture& self) { return channels_of(self, 0, self->image.channels.size()); },
          "float32 (H, W, C): all channels.")
      .def_property_readonly("rgba", &rgba_of, "float32 (H, W, 4): R G B A.")
      .def_property_readonly(
          "depth", view("Z"),
          "float32 (H, W): depth along the view where opacity passes one half, scene units;\n"
          "infinity where it never does. None: not drawn.")
      .def_property_readonly("first_depth", view("Z.first"),
                             "float32 (H, W): depth of the nearest surface, or None.")
      .def_property_readonly(
          "normals",
          [](const HeldPicture& self) {
            return vectors_or_none(self, {"N.X", "N.Y", "N.Z"});
          },
          "float32 (H, W, 3): normals in world axes, or None.")
      .def_property_readonly("weight", view("weight"),
                             "float32 (H, W): sum of the kernels of the nearest surface, or None.")
      .def_property_readonly(
          "camera",
          [](const Picture& self) -> py::object {
            if (!self.camera) return py::none();
            return py::cast(ViewCamera{*self.camera, mean_up({View{"", *self.camera}})});
          },
          "The camera that drew it, or None.")
      .def(
          "__getitem__",
          [](const HeldPicture& self, const std::string& name) {
            const py::object found = channel_or_none(self, name);
            if (found.is_none()) throw py::key_error(name);
            return found;
          },
          py::arg("channel"), "float32 (H, W): the channel of that name.")
      .def("to_uint8", &codes_of,
           "uint8 (H, W, 4), a copy: sRGB codes with straight alpha, as PNG files have them.")
      .def(
          "__array__",
          [](const HeldPicture& self, const py::object& dtype) -> py::object {
            const py::object rgba = rgba_of(self);
            return dtype.is_none() ? rgba : rgba.attr("astype")(dtype);
          },
          py::arg("dtype") = py::none())
      .def("__repr__", [](const Picture& self) {
        std::string text = "<Image of " + std::to_string(self.image.width) + " x " +
                           std::to_string(self.image.height) + " pixels:";
        for (const std::string& channel : self.image.channels) text += " " + channel;
        return text + ">";
      });
}

// Renderers.

struct ViewArguments {
  CameraOptions camera;
  ViewChoice choice;
};

void visit(Options& o, ViewArguments& a) {
  std::array<int, 2> size{a.camera.width, a.camera.height};
  o("size", size);
  a.camera.width = size[0];
  a.camera.height = size[1];
  o("eye", a.camera.eye);
  o("target", a.camera.target);
  o("up", a.camera.up);
  o("direction", a.camera.from);
  o("view", a.choice.view,
    {{"front", NamedView::kFront},
     {"back", NamedView::kBack},
     {"left", NamedView::kLeft},
     {"right", NamedView::kRight},
     {"top", NamedView::kTop},
     {"bottom", NamedView::kBottom},
     {"iso", NamedView::kIso},
     {"sensor", NamedView::kSensor}});
  o("fov", a.camera.fov);
  o("ortho", a.camera.ortho);
  o("near", a.camera.near);
  o("zoom", a.camera.zoom);
  o("frame_all", a.camera.frame_all);
}

ViewArguments view_arguments(const py::dict& given) {
  ViewArguments arguments;
  Options take(given);
  visit(take, arguments);
  with_names({{"from", "direction"}, {"width", "size"}, {"height", "size"}}, [&] {
    const std::vector<std::string> problems = arguments.camera.problems();
    if (!problems.empty()) throw_usage(problems.front());
  });
  return arguments;
}

/// The camera of a view, what is left open being guessed from a sample of the scene.
ViewCamera framed(ViewArguments view, const SurfaceSample& sample, ViewHints hints,
                  const SceneExtent& extent) {
  if (view.choice.needs_guess(view.camera)) {
    if (view.camera.up) {
      hints.up = view.camera.up;
      hints.up_reason = "as given";
    }
    aim_camera(view.camera, view.choice, guess_view(sample, hints));
  }
  return {make_camera(view.camera, extent), view.camera.up_or_y()};
}

struct RenderArguments {
  RenderOptions options;
  std::optional<bool> lit;
  std::optional<Relief> relief;
};

void visit(Options& o, RenderArguments& a) {
  RenderOptions& r = a.options;
  o("kernel", r.kernel,
    {{"affine", Kernel::kAffine}, {"perspective", Kernel::kPerspective}, {"auto", Kernel::kAuto}});
  o("kernel_tolerance", r.kernel_tolerance);
  o("filter", r.filter,
    {{"ewa", Filter::kEwa}, {"circular", Filter::kCircular}, {"none", Filter::kNone}});
  o("cutoff", r.cutoff);
  o("lowpass", r.lowpass);
  o("layers", r.layers);
  o("depth_epsilon", r.depth_epsilon);
  o("coverage_threshold", r.coverage_threshold);
  o("cull_back", r.cull_back);
  o("lit", a.lit);
  o("relief", a.relief,
    {{"none", Relief::kNone}, {"eye-dome", Relief::kEyeDome}, {"occlusion", Relief::kOcclusion}});
  o("background", r.background);
  o("lod_error", r.lod_error);
  o("aovs", r.aovs);
}

/// Surfels made ready for pictures, and how they are drawn.
class SurfelRenderer {
 public:
  /// \param source  a cloud, or the name of a file as bytes.
  /// \param scene   the name of a scene file; unset: the default light.
  SurfelRenderer(const py::object& source, const std::optional<std::string>& scene,
                 const py::dict& given, const Call& call) {
    RenderArguments arguments;
    Options take(given);
    visit(take, arguments);
    options_ = arguments.options;
    if (const std::vector<std::string> problems = options_.problems(); !problems.empty()) {
      throw_usage(problems.front());
    }
    CloudLoadOptions load{
        .columns = options_.compositing().columns(), .batch = options_.batch, .sample = true};
    load.columns.levels = true;
    const auto start = [&] {
      if (scene) scene_ = read_scene(*scene);
      choose_light(arguments, scene.has_value());
      if (options_.lit) load_environment(scene_);
    };
    if (py::isinstance<HeldCloud>(source)) {
      auto& held = source.cast<HeldCloud&>();
      const SurfelCloud& cloud = ready(held);
      const InUse use(held);
      run(call, [&] {
        loaded_ = std::make_unique<LoadedCloud>(cloud, "cloud", load);
        start();
      });
      return;
    }
    const auto path = source.cast<std::string>();
    run(call, [&] {
      loaded_ = std::make_unique<LoadedCloud>(path, load);
      start();
    });
  }

  ViewCamera frame(const py::dict& view) const {
    const ViewArguments arguments = view_arguments(view);
    return made([&] {
      return framed(arguments, loaded_->sample(),
                    {.up = loaded_->up(), .viewpoint = loaded_->viewpoint()},
                    loaded_->surfels().extent());
    });
  }

  HeldPicture render(const ViewCamera& view, const Call& call) {
    auto picture = std::make_shared<Picture>();
    picture->camera = view.camera;
    run(call, [&] {
      // A store that is streamed serves one picture at a time.
      const std::lock_guard lock(drawing_);
      Scene scene = scene_;
      if (scene.sky && !scene.sky->up) scene.sky->up = view.up;
      Renderer renderer(loaded_->store(), scene, options_);
      picture->image = renderer.render(view.camera);
    });
    return picture;
  }

  std::size_t size() const { return loaded_->surfels().size(); }

 private:
  /// Recorded colours are shown as they are, what has no colours is shaded by its relief.
  void choose_light(const RenderArguments& arguments, bool scene) {
    const ColorLight colors = loaded_->color_light();
    const bool recorded = colors == ColorLight::kRecorded && !scene;
    options_.lit = arguments.lit.value_or(!recorded);
    const bool bare = options_.lit && !scene && colors == ColorLight::kUnsaid &&
                      !loaded_->surfels().transparent();
    options_.relief = arguments.relief.value_or(bare ? Relief::kOcclusion : RenderOptions().relief);
  }

  std::unique_ptr<LoadedCloud> loaded_;
  Scene scene_ = default_scene();
  RenderOptions options_;
  std::mutex drawing_;
};

struct GaussianArguments {
  GaussianOptions options;
  std::optional<GaussianProfile> profile;
};

void visit(Options& o, GaussianArguments& a) {
  o("profile", a.profile,
    {{"inria", GaussianProfile::kInria},
     {"gsplat", GaussianProfile::kGsplat},
     {"mip", GaussianProfile::kMip},
     {"2dgs", GaussianProfile::k2dgs},
     {"exact", GaussianProfile::kExact},
     {"surfel", GaussianProfile::kSurfel}});
  o("lowpass", a.options.lowpass);
  o("samples", a.options.samples);
  o("background", a.options.background);
  o("depth", a.options.depth);
}

ViewCamera frame_gaussians(HeldGaussians& held, const py::dict& view) {
  const GaussianCloud& cloud = ready(held);
  ViewArguments arguments = view_arguments(view);
  const InUse use(held);
  return made([&] {
    // Trained files have the axes of their cameras, whose y points down.
    const Vec3d up = cloud.up.value_or(Vec3d(0, -1, 0));
    if (!arguments.camera.up && !arguments.choice.needs_guess(arguments.camera)) {
      arguments.camera.up = up;
    }
    return framed(arguments, sample_surface(cloud), {.up = up, .viewpoint = {}},
                  gaussian_extent(cloud));
  });
}

HeldPicture render_gaussians(HeldGaussians& held, const ViewCamera& view, const py::dict& given,
                             const Call& call) {
  const GaussianCloud& cloud = ready(held);
  GaussianArguments arguments;
  Options take(given);
  visit(take, arguments);
  GaussianOptions options = arguments.options;
  options.profile = arguments.profile.value_or(profile_of(cloud));
  const bool filters =
      options.profile == GaussianProfile::kExact || options.profile == GaussianProfile::kSurfel;
  take.refuse(!filters, {"lowpass"}, "unless `profile` is 'exact' or 'surfel'");
  take.refuse(options.profile != GaussianProfile::kExact, {"samples"},
              "unless `profile` is 'exact'");
  const InUse use(held);
  auto picture = std::make_shared<Picture>();
  picture->camera = view.camera;
  run(call, [&] {
    GaussianRenderer renderer(cloud, options);
    picture->image = renderer.render(view.camera);
  });
  return picture;
}

void visit(Options& o, ImageErrorOptions& a) {
  o("encoding", a.encoding, {{"srgb", ImageEncoding::kSrgb}, {"linear", ImageEncoding::kLinear}});
  o("background", a.background);
  o("threshold", a.threshold);
  o("inside_only", a.inside_only);
}

ImageErrorOptions error_options(const py::dict& given) {
  ImageErrorOptions options;
  Options take(given);
  visit(take, options);
  return options;
}

py::dict compare(const py::object& tested, const py::object& truth, const py::dict& given) {
  const HeldPicture a = picture_of(tested);
  const HeldPicture b = picture_of(truth);
  const ImageErrorOptions options = error_options(given);
  const ImageError e = made([&] { return image_error(a->image, b->image, options); });
  py::dict figures;
  figures["pixels"] = e.pixels;
  figures["nonfinite"] = e.nonfinite;
  figures["psnr"] = e.psnr;
  figures["rmse"] = e.rmse;
  figures["mean_absolute"] = e.mean_absolute;
  figures["maximum"] = e.maximum;
  figures["maximum_at"] = py::make_tuple(e.y, e.x, e.channel);
  figures["beyond"] = e.beyond;
  figures["holes"] = e.holes;
  figures["alpha_psnr"] = e.alpha_psnr;
  return figures;
}

void bind_renderers(py::module_& module) {
  py::class_<SurfelRenderer, std::shared_ptr<SurfelRenderer>>(module, "Renderer")
      .def(py::init([](const py::object& source, const std::optional<std::string>& scene,
                       const py::dict& options, const py::object& progress,
                       std::optional<int> threads) {
        return std::make_shared<SurfelRenderer>(source, scene, options, Call{progress, threads});
      }))
      .def("frame", &SurfelRenderer::frame)
      .def("render",
           [](SurfelRenderer& self, const ViewCamera& camera, const py::object& progress,
              std::optional<int> threads) {
             return self.render(camera, {progress, threads});
           })
      .def("__len__", &SurfelRenderer::size);
  module.def("frame_gaussians", &frame_gaussians);
  module.def("render_gaussians",
             [](HeldGaussians& held, const ViewCamera& camera, const py::dict& options,
                const py::object& progress, std::optional<int> threads) {
               return render_gaussians(held, camera, options, {progress, threads});
             });
  module.def("compare", &compare);
  module.def("difference", [](const py::object& tested, const py::object& truth,
                              const py::dict& given, double scale) {
    const HeldPicture a = picture_of(tested);
    const HeldPicture b = picture_of(truth);
    const ImageErrorOptions options = error_options(given);
    return std::make_shared<Picture>(Picture{
        made([&] { return difference_image(a->image, b->image, options, scale); }), std::nullopt});
  });
  module.def("view_defaults", [] { return defaults<ViewArguments>(&visit); });
  module.def("render_defaults", [] { return defaults<RenderArguments>(&visit); });
  module.def("gaussian_defaults", [] { return defaults<GaussianArguments>(&visit); });
  module.def("compare_defaults", [] { return defaults<ImageErrorOptions>(&visit); });
}

}  // namespace

HeldPicture picture_of(const py::object& given) {
  if (py::isinstance<Picture>(given)) return given.cast<HeldPicture>();
  return std::make_shared<Picture>(Picture{image_of(given, true), std::nullopt});
}

Image texture_image(const py::object& given) {
  if (!py::isinstance<Picture>(given)) return image_of(given, false);
  Image image = given.cast<Picture&>().image;
  if (image.channels.size() < 4) return image;
  const std::size_t stride = image.channels.size();
  for (std::size_t i = 0; i + 3 < image.data.size(); i += stride) {
    const float alpha = image.data[i + 3];
    for (std::size_t c = 0; c < 3 && alpha > 0; ++c) image.data[i + c] /= alpha;
  }
  return image;
}

void bind_pictures(py::module_& module) {
  bind_camera(module);
  bind_image(module);
  bind_renderers(module);
}

}  // namespace surfel::python
