#include "vision/frame_source.hpp"

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>
#include <opencv2/videoio.hpp>
#include <sys/stat.h>

#include "jpeg_pictures.hpp"
#include "support/has.hpp"
#include "support/refusal.hpp"
#include "support/temporary_folder.hpp"
#include "vision/jpeg.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using namespace vision;

void write(const TemporaryFolder& folder, const std::string& name, const Bytes& bytes) {
  std::ofstream(folder / name, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size()));
}

TEST(PictureFiles, AFolderGivesItsPicturesInTheOrderOfTheirNames) {
  const TemporaryFolder folder;
  const cv::Mat picture = grayPicture(64, 48);
  write(folder, "b.png", encoded(".png", picture));
  write(folder, "a.JPG", vision::JpegEncoder(95).encode(picture));
  write(folder, "c.bmp", encoded(".bmp", picture));
  write(folder, "d.pgm", encoded(".pgm", picture));
  write(folder, "notes.txt", Bytes(10, 'x'));
  fs::create_directory(folder / "e.png");
  const auto source = FrameSource::files(folder.path());
  Frame frame;
  for (const char* name : {"a.JPG", "b.png", "c.bmp", "d.pgm"}) {
    ASSERT_EQ(source->next(frame), FrameStatus::kFrame) << name << ": " << frame.fault;
    EXPECT_EQ(frame.name, folder / name);
    EXPECT_EQ(frame.fault, "");
    ASSERT_EQ(frame.gray.type(), CV_8UC1);
    ASSERT_EQ(frame.gray.size(), picture.size());
    EXPECT_LE(cv::norm(frame.gray, picture, cv::NORM_L1) / static_cast<double>(picture.total()),
              name[0] == 'a' ? 2.0 : 0.0);
  }
  EXPECT_EQ(frame.number, 3u);
  EXPECT_EQ(source->next(frame), FrameStatus::kEnd);
  EXPECT_EQ(source->next(frame), FrameStatus::kEnd);
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
  write(folder, "c.bmp", cut(encoded(".bmp", picture)));
  write(folder, "d.pgm", cut(encoded(".pgm", picture)));
  write(folder, "e.jpg", {});
  write(folder, "f.png", Bytes(500, 77));
  write(folder, "g.jpg", vision::JpegEncoder(95).encode(picture));
  const auto source = FrameSource::files(folder.path());
  Frame frame;
  for (const char* name : {"a.jpg", "b.png", "c.bmp", "d.pgm", "e.jpg", "f.png"}) {
    EXPECT_EQ(source->next(frame), FrameStatus::kFault) << name;
    EXPECT_EQ(frame.name, folder / name);
    EXPECT_EQ(frame.fault.find(folder / name + ": "), 0u) << frame.fault;
    EXPECT_TRUE(frame.gray.empty());
  }
  EXPECT_EQ(source->next(frame), FrameStatus::kFrame) << frame.fault;
  EXPECT_EQ(frame.fault, "");
  EXPECT_EQ(frame.number, 6u);
  EXPECT_EQ(source->next(frame), FrameStatus::kEnd);
}

TEST(PictureFiles, APictureThatIsNotOfTheCamerasSizeIsRefused) {
  const TemporaryFolder folder;
  const cv::Mat picture = grayPicture(64, 48);
  std::vector<std::string> names;
  for (const char* extension : {".bmp", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".webp"}) {
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

// The luma of an MJPEG video is decoded as it is; of others it comes by way of colours.
TEST(VideoFile, GivesItsFramesInOrder) {
  const TemporaryFolder folder;
  struct Kind {
    const char* name;
    const char* fourcc;
    double error;  // mean, in gray levels
  };
  for (const Kind& kind :
       {Kind{"a.avi", "MJPG", 2.0}, Kind{"b.mkv", "MJPG", 2.0}, Kind{"c.mp4", "mp4v", 6.0}}) {
    const std::string path = folder / kind.name;
    const char* f = kind.fourcc;
    cv::VideoWriter writer(path, cv::CAP_FFMPEG, cv::VideoWriter::fourcc(f[0], f[1], f[2], f[3]),
                           30, {320, 240}, true);
    ASSERT_TRUE(writer.isOpened()) << kind.name;
    for (int i = 0; i < 5; ++i) {
      cv::Mat colour;
      cv::cvtColor(grayPicture(320, 240, 10 * i), colour, cv::COLOR_GRAY2BGR);
      writer.write(colour);
    }
    writer.release();
    const auto source = FrameSource::files(path);
    Frame frame;
    for (unsigned i = 0; i < 5; ++i) {
      ASSERT_EQ(source->next(frame), FrameStatus::kFrame) << frame.fault;
      EXPECT_EQ(frame.name, path + "#" + std::to_string(i));
      EXPECT_EQ(frame.number, i);
      ASSERT_EQ(frame.gray.size(), cv::Size(320, 240));
      ASSERT_EQ(frame.gray.type(), CV_8UC1);
      EXPECT_LE(cv::norm(frame.gray, grayPicture(320, 240, 10 * static_cast<int>(i)), cv::NORM_L1) /
                    static_cast<double>(frame.gray.total()),
                kind.error)
          << kind.name;
    }
    EXPECT_EQ(source->next(frame), FrameStatus::kEnd);
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

TEST_F(Camera, GivesPicturesUnderItsName) {
  for (unsigned i = 0; i < 3; ++i) {
    ASSERT_EQ(source->next(frame), FrameStatus::kFrame);
    EXPECT_EQ(frame.name, "/dev/video7");
    EXPECT_EQ(frame.number, i);
    EXPECT_EQ(frame.gray.size(), cv::Size(6, 4));
  }
  EXPECT_EQ(socket.opened, 1);
}

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
