#include "vision/frame_source.hpp"

#include <fstream>

#include <gtest/gtest.h>

#include "jpeg_pictures.hpp"
#include "support/temporary_folder.hpp"
#include "vision/jpeg.hpp"

namespace helix_arm::test {
namespace {

using namespace vision;

void write(const TemporaryFolder& folder, const std::string& name, const Bytes& bytes) {
  std::ofstream(folder / name, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size()));
}

TEST(PictureFiles, ADamagedPictureIsReportedByNameAndTheNextOneIsRead) {
  const TemporaryFolder folder;
  const cv::Mat picture = grayPicture(64, 48);
  const auto cut = [](Bytes bytes) {
    bytes.resize(bytes.size() / 2);
    return bytes;
  };
  write(folder, "a.jpg", cut(vision::JpegEncoder(95).encode(picture)));
  write(folder, "b.png", cut(encoded(".png", picture)));
  write(folder, "e.jpg", {});
  write(folder, "f.png", Bytes(500, 77));
  write(folder, "g.jpg", vision::JpegEncoder(95).encode(picture));
  const auto source = FrameSource::files(folder.path());
  Frame frame;
  for (const char* name : {"a.jpg", "b.png", "e.jpg", "f.png"}) {
    EXPECT_EQ(source->next(frame), FrameStatus::kFault) << name;
    EXPECT_EQ(frame.name, folder / name);
    EXPECT_EQ(frame.fault.find(folder / name + ": "), 0u) << frame.fault;
    EXPECT_TRUE(frame.gray.empty());
  }
  EXPECT_EQ(source->next(frame), FrameStatus::kFrame) << frame.fault;
  EXPECT_EQ(frame.fault, "");
  EXPECT_EQ(frame.number, 4u);
  EXPECT_EQ(source->next(frame), FrameStatus::kEnd);
}

TEST(PictureFiles, APictureThatIsNotOfTheCamerasSizeIsRefused) {
  const TemporaryFolder folder;
  const cv::Mat picture = grayPicture(64, 48);
  std::vector<std::string> names;
  for (const char* extension : {".bmp", ".jpg", ".ppm"}) {
    names.push_back(std::string("a") + extension);
    const bool coloured = std::string(extension) == ".ppm";
    write(folder, names.back(), encoded(extension, coloured ? colourPicture(64, 48) : picture));
  }
  for (const bool wrong : {false, true}) {
    const auto source =
        FrameSource::files(folder.path(), wrong ? cv::Size(64, 47) : cv::Size(64, 48));
    Frame frame;
    for (const std::string& name : names) {
      const FrameStatus status = source->next(frame);
      EXPECT_EQ(status, wrong ? FrameStatus::kFault : FrameStatus::kFrame) << frame.fault;
      EXPECT_EQ(frame.wrong_size.has_value(), wrong) << name;
      if (!wrong) continue;
      EXPECT_EQ(*frame.wrong_size, cv::Size(64, 48));
      EXPECT_EQ(frame.fault, folder / name + ": the picture has 64 x 48 px; expected 64 x 47");
    }
  }
}

// A camera as the test has it: in its socket or not, its pictures sound or not.
struct Socket {
  bool plugged = true;
  bool sound = true;
  int opened = 0, closed = 0, tried = 0;
};

class FakeDevice : public VideoDevice {
 public:
  explicit FakeDevice(Socket* socket) : socket_(socket) {}

  std::optional<std::string> open() override {
    ++socket_->tried;
    if (!socket_->plugged) return "the device does not exist";
    ++socket_->opened;
    return std::nullopt;
  }
  Read read(cv::Mat& gray, std::string& fault) override {
    if (!socket_->plugged) {
      fault = "it gives no more pictures";
      return Read::kGone;
    }
    gray = cv::Mat(4, 6, CV_8UC1, cv::Scalar(9));
    if (socket_->sound) return Read::kPicture;
    fault = "a broken JPEG";
    return Read::kBroken;
  }
  void close() override { ++socket_->closed; }

 private:
  Socket* socket_;
};

class Camera : public testing::Test {
 protected:
  Socket socket;
  double time = 100;
  std::unique_ptr<FrameSource> source = FrameSource::camera(
      std::make_unique<FakeDevice>(&socket), "/dev/video7", 2.0, [this] { return time; });
  Frame frame;
};

TEST_F(Camera, AnUnpluggedOneIsAFaultUntilItIsBack) {
  ASSERT_EQ(source->next(frame), FrameStatus::kFrame);
  socket.plugged = false;
  ASSERT_EQ(source->next(frame), FrameStatus::kFault);
  EXPECT_EQ(frame.fault, "/dev/video7: it gives no more pictures");
  EXPECT_EQ(frame.retry_after, 2.0);
  EXPECT_TRUE(frame.gray.empty());
  EXPECT_EQ(socket.closed, 1);

  time += 1.5;  // too early to try: told at once, and for how long still
  ASSERT_EQ(source->next(frame), FrameStatus::kFault);
  EXPECT_EQ(frame.retry_after, 0.5);
  EXPECT_EQ(socket.tried, 1);

  time += 0.5;
  ASSERT_EQ(source->next(frame), FrameStatus::kFault);
  EXPECT_EQ(frame.fault, "/dev/video7: the device does not exist");
  EXPECT_EQ(frame.retry_after, 2.0);
  EXPECT_EQ(socket.tried, 2);

  socket.plugged = true;
  time += 1.0;
  ASSERT_EQ(source->next(frame), FrameStatus::kFault);
  time += 1.0;
  ASSERT_EQ(source->next(frame), FrameStatus::kFrame);
  EXPECT_EQ(frame.fault, "");
  EXPECT_EQ(frame.retry_after, 0);
  EXPECT_EQ(frame.number, 5u);
  EXPECT_EQ(socket.opened, 2);
}

}  // namespace
}  // namespace helix_arm::test
