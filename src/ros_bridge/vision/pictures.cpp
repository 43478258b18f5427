#include "pictures.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <stdexcept>

#include <opencv2/imgproc.hpp>
#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>

#include "basics/quote.hpp"

namespace helix_arm::ros_bridge {
namespace {

using basics::quoted;

constexpr std::array<const char*, kPictureFaultCount> kNames = {
    "bad_jpeg",  "wrong_encoding", "wrong_size", "bad_camera_info",
    "bad_model", "source_faults",  "bad_poses"};

constexpr int kAsItIs = -1;

// Conversion of an encoding to gray.
struct Encoding {
  std::string name;
  int channels;
  int conversion;  // of cv::cvtColor, or kAsItIs
};

// OpenCV names Bayer patterns by the second row and column, ROS by the first.
const Encoding* find(const std::string& name) {
  namespace enc = sensor_msgs::image_encodings;
  static const std::array<Encoding, 10> kEncodings = {
      {{enc::MONO8, 1, kAsItIs},
       {enc::TYPE_8UC1, 1, kAsItIs},
       {enc::BGR8, 3, cv::COLOR_BGR2GRAY},
       {enc::RGB8, 3, cv::COLOR_RGB2GRAY},
       {enc::BGRA8, 4, cv::COLOR_BGRA2GRAY},
       {enc::RGBA8, 4, cv::COLOR_RGBA2GRAY},
       {enc::BAYER_RGGB8, 1, cv::COLOR_BayerBG2GRAY},
       {enc::BAYER_BGGR8, 1, cv::COLOR_BayerRG2GRAY},
       {enc::BAYER_GBRG8, 1, cv::COLOR_BayerGR2GRAY},
       {enc::BAYER_GRBG8, 1, cv::COLOR_BayerGB2GRAY}}};
  const auto found = std::find_if(kEncodings.begin(), kEncodings.end(),
                                  [&](const Encoding& e) { return e.name == name; });
  return found == kEncodings.end() ? nullptr : &*found;
}

bool saysJpeg(std::string format) {
  std::transform(format.begin(), format.end(), format.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return format.empty() || format.find("jpeg") != std::string::npos ||
         format.find("jpg") != std::string::npos;
}

PictureRefusal refuse(PictureFault fault, const std::string& message) { return {fault, message}; }

PictureRefusal refuseInfo(const std::string& message) {
  return refuse(PictureFault::kBadCameraInfo, "camera_info " + message);
}

// Why the matrix K of a camera_info is that of no pinhole camera; empty if it is.
std::string faultOfMatrix(const sensor_msgs::CameraInfo& info, const estimation::Camera& camera) {
  const auto& K = info.K;
  if (K[8] != 1.0) return "has K[8] = " + std::to_string(K[8]) + "; expected 1";
  if (K[2] == 0 && K[5] == 0 && K[6] != 0) {
    return "has K transposed; expected fx, 0, cx, 0, fy, cy, 0, 0, 1, row by row";
  }
  if (K[1] != 0 || K[3] != 0 || K[6] != 0 || K[7] != 0) {
    return "has a skew or perspective part in K, K[1] = " + std::to_string(K[1]) +
           "; expected fx, 0, cx, 0, fy, cy, 0, 0, 1: calibrate without skew";
  }
  if (!camera.isCentred()) {
    return "has its principal point at (" + std::to_string(K[2]) + ", " + std::to_string(K[5]) +
           ") px, far from the centre of " + sizeText(info.width, info.height) +
           " pixels; expected a calibration at this size of picture";
  }
  return "";
}

}  // namespace

const char* nameOf(PictureFault fault) { return kNames[static_cast<std::size_t>(fault)]; }

CheckedPicture<cv::Mat> fromMsg(const sensor_msgs::Image& image, cv::Mat& buffer) {
  const Encoding* encoding = find(image.encoding);
  if (encoding == nullptr) {
    return refuse(PictureFault::kWrongEncoding,
                  "the picture's encoding is '" + quoted(image.encoding) +
                      "'; send mono8, bgr8, rgb8, bgra8, rgba8 or an 8-bit Bayer pattern");
  }
  if (image.width == 0 || image.height == 0) {
    return refuse(PictureFault::kWrongSize, "the picture is of " +
                                                sizeText(image.width, image.height) +
                                                " pixels; send a picture that is not empty");
  }
  const std::size_t row = static_cast<std::size_t>(image.width) * encoding->channels;
  if (image.step < row || image.data.size() / image.step < image.height) {
    return refuse(PictureFault::kWrongSize,
                  "the picture claims " + sizeText(image.width, image.height) + " pixels of " +
                      encoding->name + " but holds " + std::to_string(image.data.size()) +
                      " bytes in rows of " + std::to_string(image.step) + "; send whole pictures");
  }
  // Not written to; cv::Mat has no constructor for constant data.
  const cv::Mat raw(static_cast<int>(image.height), static_cast<int>(image.width),
                    CV_8UC(encoding->channels), const_cast<std::uint8_t*>(image.data.data()),
                    image.step);
  if (encoding->conversion == kAsItIs) return raw;
  cv::cvtColor(raw, buffer, encoding->conversion);
  return buffer;
}

CheckedPicture<cv::Mat> fromMsg(const sensor_msgs::CompressedImage& image,
                                vision::JpegDecoder& decoder, cv::Mat& buffer) {
  if (!saysJpeg(image.format)) {
    return refuse(PictureFault::kWrongEncoding,
                  "the compressed picture's format is '" + quoted(image.format) + "'; send JPEG");
  }
  if (const auto fault = decoder.decode(image.data.data(), image.data.size(), buffer)) {
    return refuse(PictureFault::kBadJpeg, "the JPEG of " + std::to_string(image.data.size()) +
                                              " bytes cannot be decoded: " + *fault);
  }
  return buffer;
}

CheckedPicture<estimation::Camera> fromMsg(const sensor_msgs::CameraInfo& info) {
  namespace models = sensor_msgs::distortion_models;
  const auto zero = [](double value) { return value == 0.0; };
  if (std::all_of(info.K.begin(), info.K.end(), zero)) {
    return refuseInfo(
        "is empty (K = 0): the camera is not calibrated; calibrate it, or set ~use_camera_info to "
        "false to use the scene's intrinsics");
  }
  const std::size_t coefficients = info.D.size();
  const bool none = coefficients == 0 || std::all_of(info.D.begin(), info.D.end(), zero);
  const bool plumb_bob =
      info.distortion_model == models::PLUMB_BOB && (coefficients == 4 || coefficients == 5);
  const bool rational = info.distortion_model == models::RATIONAL_POLYNOMIAL && coefficients == 8;
  if (!none && !plumb_bob && !rational) {
    return refuseInfo("has the distortion model '" + quoted(info.distortion_model) + "' with " +
                      std::to_string(coefficients) +
                      " coefficients; expected plumb_bob with 4 or 5, or rational_polynomial with "
                      "8: in a file, cols of distortion_coefficients is their number");
  }
  if (info.binning_x > 1 || info.binning_y > 1 || info.roi.x_offset != 0 ||
      info.roi.y_offset != 0 || (info.roi.width != 0 && info.roi.width != info.width) ||
      (info.roi.height != 0 && info.roi.height != info.height)) {
    return refuseInfo("states binning or a region of interest; send whole pictures");
  }
  constexpr std::uint32_t kLargest = 1U << 16U;  // larger than any JPEG
  const auto side = [&](std::uint32_t size) { return static_cast<int>(std::min(size, kLargest)); };
  const auto& K = info.K;
  estimation::Camera camera{side(info.width), side(info.height), K[0], K[4], K[2], K[5], {}};
  if (!none) std::copy(info.D.begin(), info.D.end(), camera.distortion.begin());
  try {
    camera.validate();
  } catch (const std::invalid_argument& error) {
    return refuseInfo(std::string("is not valid: ") + error.what());
  }
  if (const std::string fault = faultOfMatrix(info, camera); !fault.empty())
    return refuseInfo(fault);
  return camera;
}

sensor_msgs::CameraInfo toCameraInfoMsg(const std_msgs::Header& header,
                                        const estimation::Camera& camera) {
  namespace models = sensor_msgs::distortion_models;
  sensor_msgs::CameraInfo info;
  info.header = header;
  info.width = static_cast<std::uint32_t>(camera.width);
  info.height = static_cast<std::uint32_t>(camera.height);
  const auto& d = camera.distortion;
  const bool rational = d[5] != 0 || d[6] != 0 || d[7] != 0;
  info.distortion_model = rational ? models::RATIONAL_POLYNOMIAL : models::PLUMB_BOB;
  info.D.assign(d.begin(), d.begin() + (rational ? 8 : 5));
  info.K = {camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0};
  return info;
}

sensor_msgs::Image toImageMsg(const std_msgs::Header& header, const cv::Mat& picture) {
  namespace enc = sensor_msgs::image_encodings;
  sensor_msgs::Image image;
  image.header = header;
  image.width = static_cast<std::uint32_t>(picture.cols);
  image.height = static_cast<std::uint32_t>(picture.rows);
  image.encoding = picture.channels() == 1 ? enc::MONO8 : enc::BGR8;
  image.step = static_cast<std::uint32_t>(picture.cols * picture.channels());
  image.data.reserve(image.step * static_cast<std::size_t>(picture.rows));
  for (int row = 0; row < picture.rows; ++row) {
    const std::uint8_t* first = picture.ptr(row);
    image.data.insert(image.data.end(), first, first + image.step);
  }
  return image;
}

bool equal(const estimation::Camera& a, const estimation::Camera& b) {
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy &&
         a.cx == b.cx && a.cy == b.cy && a.distortion == b.distortion;
}

std::string sizeText(std::int64_t width, std::int64_t height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

}  // namespace helix_arm::ros_bridge
