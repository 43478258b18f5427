#include "ros_bridge/vision/pictures.hpp"

#include <limits>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

namespace helix_arm::ros_bridge {
namespace {

const estimation::Camera kCamera{
    640, 480, 600.5, 599.5, 320.25, 239.75, {0.1, -0.2, 0.001, -0.002, 0.05, 0, 0, 0}};

// Colours that differ from pixel to pixel.
cv::Mat colours(int width, int height) {
  cv::Mat out(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      out.at<cv::Vec3b>(y, x) = {static_cast<std::uint8_t>(7 * x), static_cast<std::uint8_t>(5 * y),
                                 static_cast<std::uint8_t>(3 * x + 11 * y)};
    }
  }
  return out;
}

cv::Mat grayOf(const sensor_msgs::Image& image) {
  cv::Mat buffer;
  const auto taken = fromMsg(image, buffer);
  if (const auto* refusal = std::get_if<PictureRefusal>(&taken)) {
    ADD_FAILURE() << refusal->message;
    return {};
  }
  return std::get<cv::Mat>(taken).clone();
}

void expectRefused(const sensor_msgs::Image& image, PictureFault fault, const std::string& word) {
  cv::Mat buffer;
  const auto taken = fromMsg(image, buffer);
  ASSERT_TRUE(std::holds_alternative<PictureRefusal>(taken));
  EXPECT_STREQ(nameOf(std::get<PictureRefusal>(taken).fault), nameOf(fault));
  const std::string& message = std::get<PictureRefusal>(taken).message;
  EXPECT_NE(message.find(word), std::string::npos) << word << " in: " << message;
  EXPECT_LT(message.size(), 400U);
}

TEST(Picture, Mono8IsTakenWithoutACopy) {
  const auto image = toImageMsg({}, cv::Mat(4, 6, CV_8UC1, cv::Scalar(17)));
  cv::Mat buffer;
  const auto taken = fromMsg(image, buffer);
  EXPECT_EQ(std::get<cv::Mat>(taken).data, image.data.data());
}

TEST(Picture, ColoursBecomeTheSameGrayInEveryEncoding) {
  const cv::Mat bgr = colours(9, 6);
  cv::Mat gray, converted;
  cv::cvtColor(bgr, gray, cv::COLOR_BGR2GRAY);
  auto image = toImageMsg({}, bgr);
  EXPECT_EQ(cv::norm(grayOf(image), gray, cv::NORM_INF), 0);
  cv::cvtColor(bgr, converted, cv::COLOR_BGR2RGB);
  image = toImageMsg({}, converted);
  image.encoding = "rgb8";
  EXPECT_EQ(cv::norm(grayOf(image), gray, cv::NORM_INF), 0);
  for (const auto& [encoding, conversion] :
       {std::pair("bgra8", cv::COLOR_BGR2BGRA), std::pair("rgba8", cv::COLOR_BGR2RGBA)}) {
    cv::cvtColor(bgr, converted, conversion);
    image.encoding = encoding;
    image.step = static_cast<std::uint32_t>(converted.step);
    image.data.assign(converted.datastart, converted.dataend);
    EXPECT_EQ(cv::norm(grayOf(image), gray, cv::NORM_INF), 0) << encoding;
  }
}

TEST(Picture, BayerPatternsAreNamedByTheirFirstPixels) {
  // One colour all over, in the mosaic's own values: red 200, green 100, blue 50.
  const double expected = 0.299 * 200 + 0.587 * 100 + 0.114 * 50;
  for (const std::string pattern : {"rggb", "bggr", "gbrg", "grbg"}) {
    cv::Mat mosaic(8, 8, CV_8UC1);
    for (int y = 0; y < 8; ++y) {
      for (int x = 0; x < 8; ++x) {
        const char c = pattern[2 * (y % 2) + x % 2];
        mosaic.at<std::uint8_t>(y, x) = c == 'r' ? 200 : c == 'g' ? 100 : 50;
      }
    }
    auto image = toImageMsg({}, mosaic);
    image.encoding = "bayer_" + pattern + "8";
    const cv::Mat gray = grayOf(image);
    ASSERT_FALSE(gray.empty());
    EXPECT_NEAR(gray.at<std::uint8_t>(4, 4), expected, 1.0) << pattern;
  }
}

TEST(Picture, RowsMayBePadded) {
  const cv::Mat bgr = colours(5, 3);
  sensor_msgs::Image image = toImageMsg({}, bgr);
  const auto tight = image;
  image.step += 7;
  image.data.assign(static_cast<std::size_t>(image.step) * image.height, 0);
  for (std::uint32_t row = 0; row < image.height; ++row) {
    std::copy_n(&tight.data[row * tight.step], tight.step, &image.data[row * image.step]);
  }
  EXPECT_EQ(cv::norm(grayOf(image), grayOf(tight), cv::NORM_INF), 0);
}

TEST(Picture, AFileThatIsNotAPictureIsRefused) {
  const auto sound = toImageMsg({}, cv::Mat(4, 6, CV_8UC1, cv::Scalar(0)));
  auto image = sound;
  image.encoding = "yuv422";
  expectRefused(image, PictureFault::kWrongEncoding, "'yuv422'");
  image.encoding = std::string(2'000'000, 'x');
  expectRefused(image, PictureFault::kWrongEncoding, "xxx...");
  expectRefused(sensor_msgs::Image(), PictureFault::kWrongEncoding, "''");
  image = sound;
  image.width = 0;
  expectRefused(image, PictureFault::kWrongSize, "0 x 4");
  image = sound;
  image.height = 0;
  expectRefused(image, PictureFault::kWrongSize, "6 x 0");
  image = sound;
  image.data.pop_back();
  expectRefused(image, PictureFault::kWrongSize, "23 bytes");
  image = sound;
  image.step = 5;
  expectRefused(image, PictureFault::kWrongSize, "rows of 5");
  image = sound;
  image.step = 0;
  expectRefused(image, PictureFault::kWrongSize, "rows of 0");
  image = sound;
  image.encoding = "bgr8";
  expectRefused(image, PictureFault::kWrongSize, "bgr8");
  image = sound;
  image.width = image.height = image.step = std::numeric_limits<std::uint32_t>::max();
  expectRefused(image, PictureFault::kWrongSize, "24 bytes");
}

TEST(Picture, OnlyJpegIsDecoded) {
  vision::JpegDecoder decoder;
  cv::Mat buffer;
  sensor_msgs::CompressedImage image;
  const auto faultOf = [&] {
    return std::get<PictureRefusal>(fromMsg(image, decoder, buffer)).fault;
  };
  image.data = vision::JpegEncoder(90).encode(cv::Mat(16, 16, CV_8UC1, cv::Scalar(99)));
  for (const char* format : {"", "jpeg", "JPG", "mono8; jpeg compressed mono8"}) {
    image.format = format;
    EXPECT_TRUE(std::holds_alternative<cv::Mat>(fromMsg(image, decoder, buffer))) << format;
  }
  image.format = "bgr8; png compressed bgr8";
  EXPECT_EQ(faultOf(), PictureFault::kWrongEncoding);
  image.format = "jpeg";
  image.data.resize(image.data.size() / 2);
  EXPECT_EQ(faultOf(), PictureFault::kBadJpeg);
  image.data.clear();
  EXPECT_EQ(faultOf(), PictureFault::kBadJpeg);
}

TEST(CameraInfo, SurvivesTheRoundTrip) {
  estimation::Camera rational = kCamera;
  rational.distortion = {0.1, -0.2, 0.001, -0.002, 0.05, 0.3, -0.1, 0.02};
  estimation::Camera pinhole = kCamera;
  pinhole.distortion = {};
  for (const estimation::Camera& camera : {kCamera, rational, pinhole}) {
    const auto taken = fromMsg(toCameraInfoMsg({}, camera));
    ASSERT_TRUE(std::holds_alternative<estimation::Camera>(taken));
    EXPECT_TRUE(equal(std::get<estimation::Camera>(taken), camera));
  }
  EXPECT_FALSE(equal(kCamera, rational));
}

TEST(CameraInfo, AnInvalidCalibrationIsRefused) {
  const auto sound = toCameraInfoMsg({}, kCamera);
  const auto expectRefusedInfo = [](const sensor_msgs::CameraInfo& info, const std::string& word) {
    const auto taken = fromMsg(info);
    ASSERT_TRUE(std::holds_alternative<PictureRefusal>(taken)) << word;
    const auto& refusal = std::get<PictureRefusal>(taken);
    EXPECT_EQ(refusal.fault, PictureFault::kBadCameraInfo);
    EXPECT_NE(refusal.message.find(word), std::string::npos) << word << " in: " << refusal.message;
  };
  auto info = sound;
  info.K.fill(0);
  expectRefusedInfo(info, "K = 0");
  expectRefusedInfo(sensor_msgs::CameraInfo(), "not calibrated");
  info = sound;
  info.K[0] = -600;
  expectRefusedInfo(info, "is not valid");
  info = sound;
  info.K[2] = std::nan("");
  expectRefusedInfo(info, "is not valid");
  info = sound;
  info.width = 0;
  expectRefusedInfo(info, "is not valid");
  info = sound;
  info.distortion_model = "equidistant";
  expectRefusedInfo(info, "'equidistant'");
  info = sound;
  info.D.assign(14, 0.1);
  info.distortion_model = "rational_polynomial";
  expectRefusedInfo(info, "14 coefficients");
  info = sound;
  info.binning_x = 2;
  expectRefusedInfo(info, "binning");
  info = sound;
  info.roi.x_offset = 10;
  expectRefusedInfo(info, "region");
}

TEST(PictureFault, NamesAreTheFieldsOfTheStatus) {
  EXPECT_STREQ(nameOf(PictureFault::kBadJpeg), "bad_jpeg");
  EXPECT_STREQ(nameOf(PictureFault::kWrongEncoding), "wrong_encoding");
  EXPECT_STREQ(nameOf(PictureFault::kWrongSize), "wrong_size");
  EXPECT_STREQ(nameOf(PictureFault::kBadCameraInfo), "bad_camera_info");
  EXPECT_STREQ(nameOf(PictureFault::kBadModel), "bad_model");
  EXPECT_STREQ(nameOf(PictureFault::kSource), "source_faults");
}

}  // namespace
}  // namespace helix_arm::ros_bridge
