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
  using Image = sensor_msgs::Image;
  const struct {
    PictureFault fault;
    const char* word;
    void (*spoil)(Image& image);
  } kRows[] = {
      {PictureFault::kWrongEncoding, "'yuv422'", [](Image& i) { i.encoding = "yuv422"; }},
      {PictureFault::kWrongEncoding, "xxx...", [](Image& i) { i.encoding.assign(2'000'000, 'x'); }},
      {PictureFault::kWrongEncoding, "''", [](Image& i) { i = {}; }},
      {PictureFault::kWrongSize, "0 x 4", [](Image& i) { i.width = 0; }},
      {PictureFault::kWrongSize, "6 x 0", [](Image& i) { i.height = 0; }},
      {PictureFault::kWrongSize, "23 bytes", [](Image& i) { i.data.pop_back(); }},
      {PictureFault::kWrongSize, "rows of 5", [](Image& i) { i.step = 5; }},
      {PictureFault::kWrongSize, "rows of 0", [](Image& i) { i.step = 0; }},
      {PictureFault::kWrongSize, "bgr8", [](Image& i) { i.encoding = "bgr8"; }},
      {PictureFault::kWrongSize, "24 bytes",
       [](Image& i) { i.width = i.height = i.step = std::numeric_limits<std::uint32_t>::max(); }},
  };
  for (const auto& row : kRows) {
    Image image = sound;
    row.spoil(image);
    cv::Mat buffer;
    const auto taken = fromMsg(image, buffer);
    ASSERT_TRUE(std::holds_alternative<PictureRefusal>(taken)) << row.word;
    const auto& refusal = std::get<PictureRefusal>(taken);
    EXPECT_STREQ(nameOf(refusal.fault), nameOf(row.fault)) << row.word;
    EXPECT_NE(refusal.message.find(row.word), std::string::npos) << row.word << refusal.message;
    EXPECT_LT(refusal.message.size(), 400U);
  }
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
  using Info = sensor_msgs::CameraInfo;
  const struct {
    const char* word;
    void (*spoil)(Info& info);
  } kRows[] = {
      {"K = 0", [](Info& i) { i.K.fill(0); }},
      {"not calibrated", [](Info& i) { i = {}; }},
      {"is not valid", [](Info& i) { i.K[0] = -600; }},
      {"is not valid", [](Info& i) { i.K[2] = std::nan(""); }},
      {"is not valid", [](Info& i) { i.width = 0; }},
      {"'equidistant'", [](Info& i) { i.distortion_model = "equidistant"; }},
      {"14 coefficients",
       [](Info& i) {
         i.D.assign(14, 0.1);
         i.distortion_model = "rational_polynomial";
       }},
      {"binning", [](Info& i) { i.binning_x = 2; }},
      {"region", [](Info& i) { i.roi.x_offset = 10; }},
  };
  for (const auto& row : kRows) {
    Info info = toCameraInfoMsg({}, kCamera);
    row.spoil(info);
    const auto taken = fromMsg(info);
    ASSERT_TRUE(std::holds_alternative<PictureRefusal>(taken)) << row.word;
    const auto& refusal = std::get<PictureRefusal>(taken);
    EXPECT_EQ(refusal.fault, PictureFault::kBadCameraInfo);
    EXPECT_NE(refusal.message.find(row.word), std::string::npos) << row.word << refusal.message;
  }
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
