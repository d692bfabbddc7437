#include "tools/bolod/config.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "drivers/shm/shm_section.hpp"
#include "drivers/v4l2/v4l2_section.hpp"
#include "src/capture/pixel_maps_io.hpp"
#include "tests/scratch.hpp"

namespace bolo::daemon::config_test {
namespace {

const std::string kShipped = std::string(BOLO_SOURCE_DIR) + "/config/bolod.toml";

class Config : public testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }

  Result<DaemonConfig> read(const std::string& text) const {
    write("bolod.toml", text);
    return read_config(folder_ / "bolod.toml");
  }

  // The message without the folder; "" when the text is right.
  std::string complaint(const std::string& text) const {
    const auto config = read(text);
    if (config) return "";
    EXPECT_EQ(config.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(config.error().message.find('\n'), std::string::npos);
    EXPECT_TRUE(config.error().message.starts_with(folder_.string())) << config.error().message;
    return config.error().message.substr(folder_.string().size() + 1);
  }

  const Scratch scratch_;
  const std::filesystem::path folder_ = scratch_.path();
};

TEST_F(Config, AnEmptyFileIsAnA655scAt200Hz) {
  const auto config = read("");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->source, SourceType::kGenicam);
  EXPECT_EQ(config->camera.width, 640);
  EXPECT_EQ(config->camera.height, 120);
  EXPECT_DOUBLE_EQ(config->camera.rate_hz, 200.0);
  EXPECT_DOUBLE_EQ(config->pipeline.deblur.tau_s, 0.011);
  EXPECT_DOUBLE_EQ(config->pipeline.deblur.period_s, 0.005);
  EXPECT_EQ(config->sinks.at(0)->describe(config->sink_context()), "shared memory /bolo.camera");
}

TEST_F(Config, AGyroNeedsTheSolverAndTheLens) {
  write("lens.toml", "[lens]\nfocal_px = 1400\n[gyro]\ndelay_s = 0.002\n");
  const std::string motion = "[deblur]\nsolver = 'motion'\n";
  const auto config = read("profile = 'lens.toml'\n" + motion + "[motion]\ngyro = 'shm:imu'\n");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->gyro, "shm:imu");
  EXPECT_EQ(config->pipeline.deblur.gyro_setup.focal_px, 1400.0);
  EXPECT_EQ(config->pipeline.deblur.gyro_setup.delay_s, 0.002);
  const std::string gyro = "[motion]\ngyro = 'shm:imu'\n";
  EXPECT_NE(complaint(motion + gyro).find("lens.focal_px"), std::string::npos);
  EXPECT_NE(complaint("profile = 'lens.toml'\n" + gyro).find("solver motion"), std::string::npos);
  EXPECT_NE(complaint("profile = 'lens.toml'\n" + motion + "[motion]\ngyro = 'imu'\n").find("shm:NAME"),
            std::string::npos);
  EXPECT_NE(complaint("profile = 'lens.toml'\n" + motion + "[motion]\ngyro = 'shm:a/b'\n").find("no name"),
            std::string::npos);
}

TEST_F(Config, ANameThatNoFileCanHaveIsNotThere) {
  const std::string name(300, 'n');
  EXPECT_NE(complaint("[source]\ntype = 'replay'\nfile = '" + name + "'\n").find("there is no"), std::string::npos);
}

TEST_F(Config, KeysReachTheirPlaces) {
  write("a.h5", "");
  const auto config = read(
      "name = 'front'\n"
      "[source]\ntype = 'replay'\nfile = 'a.h5'\npace = 'fast'\n"
      "[deblur]\nsolver = 'inverse'\nlambda = 0.5\nkappa = 2\niterations = 9\nwindow = 9\nlevels = 5\nlookahead = 1\n"
      "workers = 3\ntau_s = 0.008\n"
      "[pipeline]\nqueue_frames = 5\nrealtime_priority = 20\ncpus = [0, 1]\nlock_memory = false\n"
      "[shm]\nslots = 100\nmode = 0o640\ngroup = 'video'\n"
      "[log]\nlevel = 'debug'\nformat = 'journal'\n");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->source, SourceType::kReplay);
  EXPECT_EQ(config->replay.file, folder_ / "a.h5") << "relative to the configuration";
  EXPECT_EQ(config->replay.pace, replay::Pace::kAsFastAsPossible);
  const deblur::Settings& settings = config->pipeline.deblur;
  EXPECT_EQ(settings.method, deblur::Method::kInverse);
  EXPECT_EQ(settings.lambda, 0.5);
  EXPECT_EQ(settings.kappa, 2.0);
  EXPECT_EQ(settings.iterations, 9);
  EXPECT_EQ(settings.window, 9);
  EXPECT_EQ(settings.levels, 5);
  EXPECT_EQ(settings.lookahead, 1);
  EXPECT_EQ(settings.tau_s, 0.008);
  EXPECT_EQ(config->pipeline.workers, 3);
  EXPECT_EQ(config->pipeline.queue_frames, 5);
  EXPECT_EQ(config->pipeline.thread.realtime_priority, 20);
  EXPECT_EQ(config->pipeline.thread.cpus, (std::vector<int>{0, 1}));
  EXPECT_FALSE(config->lock_memory);
  const auto& shared = dynamic_cast<const shm::ShmSection&>(*config->sinks.at(0));
  EXPECT_EQ(shared.describe(config->sink_context()), "shared memory /bolo.front");
  EXPECT_EQ(shared.options().slots, 100);
  EXPECT_EQ(shared.options().mode, 0640U);
  EXPECT_EQ(shared.options().group, "video");
  EXPECT_EQ(config->log.level, LogLevel::kDebug);
  EXPECT_EQ(config->log.format, LogFormat::kJournal);
}

TEST_F(Config, PacketsTooSmallForAFrameAreRefused) {
  for (const char* size : {"1", "60", "575"}) {
    const auto config = read("[source]\npacket_size = " + std::string(size) + "\n");
    ASSERT_FALSE(config) << size;
    EXPECT_NE(config.error().message.find("576 bytes or more, or 0"), std::string::npos) << config.error().message;
  }
  EXPECT_TRUE(read("[source]\npacket_size = 576\n"));
}

TEST_F(Config, CameraKeysReachTheCamera) {
  const auto config = read(
      "[source]\naddress = '10.0.0.2'\nwidth = 320\nheight = 0\nir_format = '100mk'\npixel_order = 'big'\n"
      "metadata_rows = 3\npacket_size = 1400\nsocket_buffer_bytes = 1000000\nresend = true\npacket_timeout_us = 300\n"
      "frame_retention_us = 4000\nbuffers = 20\nrealtime_priority = 10\nrate_hz = 50\ntrue_rate_hz = 49.5\n"
      "stall_ms = 100\n"
      "reconnect_after_ms = 0\n");
  ASSERT_TRUE(config) << config.error().message;
  const genicam::CameraOptions& camera = config->camera;
  EXPECT_EQ(camera.address, "10.0.0.2");
  EXPECT_EQ(camera.width, 320);
  EXPECT_EQ(camera.height, 0);
  EXPECT_EQ(camera.ir_format, genicam::IrFormat::kTemperatureLinear100mK);
  EXPECT_EQ(camera.pixel_order, genicam::PixelOrder::kBigEndian);
  EXPECT_EQ(camera.metadata_rows, 3);
  EXPECT_EQ(camera.packet_size, 1400);
  EXPECT_EQ(camera.true_rate_hz, 49.5);
  EXPECT_EQ(camera.socket_buffer_bytes, 1000000);
  EXPECT_TRUE(camera.resend);
  EXPECT_EQ(camera.packet_timeout_us, 300);
  EXPECT_EQ(camera.frame_retention_us, 4000);
  EXPECT_EQ(camera.buffers, 20);
  EXPECT_EQ(camera.realtime_priority, 10);
  EXPECT_EQ(camera.rate_hz, 50.0);
  EXPECT_EQ(camera.stall_ms, 100);
  EXPECT_EQ(camera.reconnect_after_ms, 0);
}

TEST_F(Config, TheProfileDecidesUnlessAKeyTakesItsPlace) {
  write("cam.toml",
        "tau_s = 0.009\nframe_period_s = 0.01\nnoise_k = 0.05\nquantisation_k = 0.01\n[transport]\nbyte_order = "
        "'big'\nmetadata_rows = 3\n");
  auto config = read("profile = 'cam.toml'\n");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_DOUBLE_EQ(config->pipeline.deblur.tau_s, 0.009);
  EXPECT_DOUBLE_EQ(config->camera.rate_hz, 100.0);
  EXPECT_EQ(config->camera.pixel_order, genicam::PixelOrder::kBigEndian);
  EXPECT_EQ(config->camera.metadata_rows, 3);
  config = read(
      "profile = 'cam.toml'\n[source]\npixel_order = 'little'\nmetadata_rows = 0\nrate_hz = 0\n[deblur]\n"
      "tau_s = 0.012\n");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_DOUBLE_EQ(config->pipeline.deblur.tau_s, 0.012);
  EXPECT_DOUBLE_EQ(config->camera.rate_hz, 0.0);
  EXPECT_EQ(config->camera.pixel_order, genicam::PixelOrder::kLittleEndian);
  EXPECT_EQ(config->camera.metadata_rows, 0);
}

TEST_F(Config, MistakesAreNamed) {
  write("bad.toml", "tau_s = 0.01\ntaus = 1\n");
  write("maps.toml", "maps = 'none.h5'\n");
  const std::vector<std::pair<std::string, std::string>> cases{
      {"nmae = 'x'", "bolod.toml:1:1: unknown key 'nmae'; did you mean 'name'?"},
      {"name = 'a b'",
       "bolod.toml:1:8: name: 'a b' is no name for shared memory; use 1 to 200 letters, digits, '-', "
       "'_', '.'"},
      {"name = ''",
       "bolod.toml:1:8: name: '' is no name for shared memory; use 1 to 200 letters, digits, '-', '_', "
       "'.'"},
      {"profile = 'none.toml'", "none.toml: no such file"},
      {"profile = 'bad.toml'", "bad.toml:2:1: unknown key 'taus'; did you mean 'tau_s'?"},
      {"[source]\ntype = 'disk'",
       "bolod.toml:2:8: source.type = \"disk\" is none of \"genicam\" | \"v4l2\" | \"replay\""},
      {"[source]\ntype = 'replay'",
       "bolod.toml:2:8: source.type = \"replay\" needs source.file, the capture to replay"},
      {"[source]\nwidth = 5000", "bolod.toml:2:9: source.width = 5000 is out of range: 0 to 4096 pixels"},
      {"[source]\nbuffers = 1", "bolod.toml:2:11: source.buffers = 1 is out of range: 4 to 1024 frames"},
      {"[deblur]\nlamda = 1", "bolod.toml:2:1: unknown key 'deblur.lamda'; did you mean 'deblur.lambda'?"},
      {"[deblur]\nlambda = -1",
       "bolod.toml:2:10: deblur.lambda = -1 is out of range: 0 to 1000000 K (counts when the source has no kelvin), "
       "or \"auto\""},
      {"[deblur]\nlambda = 'some'",
       "bolod.toml:2:10: deblur.lambda must be a number: 0 to 1000000 K (counts when the source has no kelvin), or "
       "\"auto\""},
      {"[deblur]\nsolver = 'magic'",
       "bolod.toml:2:10: deblur.solver = \"magic\" is none of \"admm\" | \"dual\" | \"exact\" | \"inverse\" | "
       "\"mmae\" | \"motion\""},
      {"profile = 'maps.toml'", "none.h5: cannot be opened: No such file or directory"},
      {"[deblur]\nworkers = 0", "bolod.toml:2:11: deblur.workers = 0 is out of range: 1 to 64 threads"},
      {"[shm]\nslots = 10",
       "bolod.toml:2:9: shm.slots = 10 is less than window + lookahead = 17; give that or more, or 0"},
      {"[source]\ntype = 'replay'\nfile = 'none.h5'",
       "bolod.toml:3:8: source.file: there is no " + (folder_ / "none.h5").string()},
      {"[source]\naddress = '999.1.2.3'",
       "bolod.toml:2:11: source.address = \"999.1.2.3\" is no IPv4 address such as 192.168.2.5"},
      {"[source]\naddress = '192.168.2'",
       "bolod.toml:2:11: source.address = \"192.168.2\" is no IPv4 address such as 192.168.2.5"},
      {"[shm]\nmode = 0o666",
       "bolod.toml:2:8: shm.mode lets others write into the frames; use 0640 for a group's readers, 0644 for everyone"},
      {"[control]\nsocket = '/run/" + std::string(200, 'x') + "'",
       "bolod.toml:2:10: control socket /run/" + std::string(200, 'x') +
           ": longer than 107 letters; set control.socket to a shorter path"},
      {"[source]\nwidth = 321\n[v4l2]\nenable = true\nformat = 'yuyv'",
       "bolod.toml:5:10: v4l2: yuyv needs an even width, not 321; use grey"},
      {"[shm]\nmode = 0o444", "bolod.toml:2:8: shm.mode = 0o444 is out of range: 0o600 to 0o777"},
      {"[v4l2]\ngain = 'fixed'\nlow_k = 300\nhigh_k = 300", "bolod.toml:4:10: v4l2: low_k must be below high_k"},
      {"[v4l2_second]\nlow_percent = 60\nhigh_percent = 50",
       "bolod.toml: v4l2_second: low_percent must be below high_percent"},
      {"[v4l2]\nenable = true\n[v4l2_second]\nenable = true\ndevice = '/dev/video10'",
       "bolod.toml:5:10: v4l2 and v4l2_second have the same device /dev/video10"},
      {"[v4l2]\nformat = 'gray'", "bolod.toml:2:10: v4l2.format = \"gray\" is none of \"y16\" | \"grey\" | \"yuyv\""},
      {"[metrics]\nlisten = '9464'",
       "bolod.toml:2:10: metrics.listen = \"9464\" is no ADDRESS:PORT such as 127.0.0.1:9464"},
      {"[metrics]\nlisten = '0.0.0.0:9464'",
       "bolod.toml:2:10: metrics.listen = \"0.0.0.0:9464\" is within other computers' reach: use 127.0.0.1, or set "
       "metrics.allow_remote = true"},
      {"[log]\nlevel = 'loud'",
       "bolod.toml:2:9: log.level = \"loud\" is none of \"debug\" | \"info\" | \"warning\" | \"error\""},
      {"[logs]\nlevel = 'info'", "bolod.toml:1:2: unknown key 'logs'; did you mean 'log'?"},
  };
  for (const auto& [text, expected] : cases) EXPECT_EQ(complaint(text), expected) << text;
}

TEST_F(Config, LambdaIsAutomaticUnlessGiven) {
  EXPECT_TRUE(DaemonConfig().pipeline.deblur.auto_lambda);
  EXPECT_EQ(DaemonConfig().pipeline.deblur.method, deblur::Method::kAdmm);
  auto config = read("[deblur]\nlambda = 'auto'\nnoise_k = 0.05\nsolver = 'mmae'\n");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_TRUE(config->pipeline.deblur.auto_lambda);
  EXPECT_EQ(config->pipeline.deblur.noise_k, 0.05);
  EXPECT_EQ(config->pipeline.deblur.method, deblur::Method::kMmae);
  config = read("[deblur]\nlambda = 0.25\nsolver = 'dual'\n");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_FALSE(config->pipeline.deblur.auto_lambda);
  EXPECT_EQ(config->pipeline.deblur.lambda, 0.25);
  EXPECT_EQ(config->pipeline.deblur.method, deblur::Method::kDual);
}

TEST_F(Config, AnInstructionSetThatIsNotHereIsRefusedWithThoseThatAre) {
  const std::string said = complaint("[deblur]\nisa = 'MMX'\n");
  EXPECT_TRUE(said.starts_with("bolod.toml:2:7: ")) << said;
  EXPECT_NE(said.find("\"MMX\" is not available here; use one of auto, "), std::string::npos) << said;
  const auto config = read("[deblur]\nisa = 'auto'\n");
  ASSERT_TRUE(config);
  EXPECT_EQ(config->isa, "auto");
}

TEST_F(Config, MapsComeWithTheProfile) {
  model::PixelMaps maps;
  maps.geometry = {4, 2};
  maps.gain.assign(8, 1.5F);
  ASSERT_TRUE(capture::write_pixel_maps(folder_ / "maps.h5", maps));
  write("cam.toml", "row_delay_s = 2e-5\nmaps = 'maps.h5'\n");
  const auto config = read("profile = 'cam.toml'\n");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->pipeline.maps.gain, maps.gain);
  EXPECT_EQ(config->pipeline.maps.row_delay_s, 2e-5);
  EXPECT_TRUE(read("")->pipeline.maps.empty());
}

TEST_F(Config, RemovedUsbStreamsAreNamedWithWhatToUse) {
  EXPECT_EQ(
      complaint("[source]\ntype = 'usb'\n"),
      "bolod.toml:2:8: source.type = \"usb\" was removed: use \"genicam\", which receives USB3 Vision cameras too, or "
      "\"replay\"");
  EXPECT_EQ(
      complaint("[source]\ntype = 'genicam'\n[usb]\ndevice = '09cb:1007'\n"),
      "bolod.toml:3:2: 'usb' was removed: delete the section; source.type = \"genicam\" receives USB3 Vision cameras");
  EXPECT_TRUE(
      complaint("[source]\ntype = 'usb'\n[usb]\ndevice = '09cb:1007'\n").ends_with("or \"replay\" (and 1 more wrong)"));
}

TEST_F(Config, SettingsThatDoNotFitTogetherAreNamed) {
  EXPECT_NE(complaint("[deblur]\nwindow = 16\n").find("window"), std::string::npos);
  EXPECT_NE(complaint("[deblur]\nwindow = 5\nlookahead = 4\n").find("lookahead"), std::string::npos);
}

TEST_F(Config, VideoKeysReachTheirDevices) {
  const auto config = read(
      "[v4l2]\nenable = true\nformat = 'grey'\nplane = 'raw'\ngain = 'fixed'\nlow_k = 290\nhigh_k = 310\n"
      "[v4l2_second]\nenable = true\ny16_unit = '100mk'\n");
  ASSERT_TRUE(config) << config.error().message;
  const auto section = [&](std::size_t i) { return dynamic_cast<const v4l2::V4l2Section&>(*config->sinks.at(i)); };
  const v4l2::V4l2Options first = section(1).options();
  const v4l2::V4l2Options second = section(2).options();
  EXPECT_EQ(section(1).describe(config->sink_context()), "/dev/video10 (raw, grey)");
  EXPECT_EQ(first.device, "/dev/video10");
  EXPECT_EQ(first.plane, v4l2::Plane::kRaw);
  EXPECT_EQ(first.format, v4l2::PixelFormat::kGrey);
  EXPECT_EQ(first.agc.gain, v4l2::Gain::kFixed);
  EXPECT_EQ(first.agc.low_k, 290.0);
  EXPECT_EQ(first.agc.high_k, 310.0);
  EXPECT_EQ(section(2).describe(config->sink_context()), "/dev/video11 (raw, y16)");
  EXPECT_EQ(second.device, "/dev/video11");
  EXPECT_EQ(second.y16_unit, v4l2::Y16Unit::k100mK);
  EXPECT_EQ(second.agc.gain, v4l2::Gain::kAuto) << "the first device's keys are its own";
}

TEST_F(Config, MetricsAreForThisComputerUnlessAllowed) {
  EXPECT_FALSE(DaemonConfig().metrics.enabled);
  for (const char* listen : {"127.0.0.1:9464", "127.1.2.3:1", "[::1]:65535"}) {
    EXPECT_EQ(complaint(std::string("[metrics]\nlisten = '") + listen + "'\n"), "") << listen;
  }
  EXPECT_EQ(complaint("[metrics]\nlisten = '0.0.0.0:9464'\nallow_remote = true\n"), "");
  for (const char* listen :
       {"10.0.0.1:9464", "[::]:9464", "localhost:9464", "127.0.0.1:0", "127.0.0.1:99999", ":9464"}) {
    EXPECT_NE(complaint(std::string("[metrics]\nlisten = '") + listen + "'\n"), "") << listen;
  }
}

TEST_F(Config, TheShippedFileIsTheDocumentedDefault) {
  std::ifstream in(kShipped);
  std::stringstream text;
  text << in.rdbuf();
  EXPECT_EQ(text.str(), document_config()) << "config/bolod.toml is out of date: bolod --print-config > it";
  const auto config = read_config(kShipped);
  EXPECT_TRUE(config) << config.error().message;
}

}  // namespace
}  // namespace bolo::daemon::config_test
