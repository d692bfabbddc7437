// The configuration file, and the changes that a running daemon applies.
#include <prometheus/text_serializer.h>

#include "drivers/shm/shm_sink.hpp"
#include "drivers/v4l2/v4l2_sink.hpp"
#include "src/capture/pixel_maps_io.hpp"
#include "tests/drivers/v4l2/fake_port.hpp"
#include "tests/pipeline/fakes.hpp"
#include "tests/tools/program.hpp"
#include "tools/bolod/config.hpp"
#include "tools/bolod/control.hpp"
#include "tools/bolod/metrics.hpp"

namespace bolo::daemon::config_test {

const std::string kShipped = std::string(BOLO_SOURCE_DIR) + "/config/bolod.toml";

class Config : public ScratchTest {
 protected:
  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }

  Result<DaemonConfig> read(const std::string& text) const {
    write("bolod.toml", text);
    return read_config(folder_ / "bolod.toml");
  }

  // Error message without the folder; "" if valid.
  std::string complaint(const std::string& text) const {
    const auto config = read(text);
    if (config) return "";
    EXPECT_EQ(config.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(config.error().message.find('\n'), std::string::npos);
    EXPECT_TRUE(config.error().message.starts_with(folder_.string())) << config.error().message;
    return config.error().message.substr(folder_.string().size() + 1);
  }
  DaemonConfig good(const std::string& text) const { return *must(read(text)); }

  const std::filesystem::path folder_ = scratch_.path();
};

TEST_F(Config, AnEmptyFileIsAnA655scAt200Hz) {
  const auto config = must(read(""));
  EXPECT_FALSE(config->metrics.enabled);
  EXPECT_TRUE(config->pipeline.maps.empty());
  EXPECT_TRUE(config->pipeline.deblur.auto_lambda);
  EXPECT_EQ(config->pipeline.deblur.method, deblur::Method::kAdmm);
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
  const std::string lens = "profile = 'lens.toml'\n";
  const std::string motion = "[deblur]\nsolver = 'motion'\n[motion]\n";
  const auto config = good(lens + motion + "gyro = 'shm:imu'\n");
  EXPECT_EQ(config.gyro, "shm:imu");
  EXPECT_EQ(config.pipeline.deblur.gyro_setup.focal_px, 1400.0);
  EXPECT_EQ(config.pipeline.deblur.gyro_setup.delay_s, 0.002);
  expect_parts(complaint(motion + "gyro = 'shm:imu'\n"), {"lens.focal_px"});
  expect_parts(complaint(lens + "[motion]\ngyro = 'shm:imu'\n"), {"solver motion"});
  expect_parts(complaint(lens + motion + "gyro = 'imu'\n"), {"shm:NAME"});
  expect_parts(complaint(lens + motion + "gyro = 'shm:a/b'\n"), {"no name"});
}

// One table of keys serves reading and documentation: a key in a wrong section shows in the shipped file.
TEST_F(Config, KeysOfEachKindReachTheirPlaces) {
  write("a.h5", "");
  const auto config = good(
      "name = 'front'\n"
      "[source]\ntype = 'replay'\nfile = 'a.h5'\npace = 'fast'\naddress = '10.0.0.2'\nheight = 0\nir_format = '100mk'\n"
      "pixel_order = 'big'\nresend = true\ntrue_rate_hz = 49.5\nrealtime_priority = 10\nreconnect_after_ms = 0\n"
      "[deblur]\nsolver = 'inverse'\nlambda = 0.5\nlookahead = 1\n"
      "[pipeline]\nrealtime_priority = 20\ncpus = [0, 1]\nlock_memory = false\n"
      "[shm]\nslots = 100\nmode = 0o640\ngroup = 'video'\n"
      "[log]\nlevel = 'debug'\nformat = 'journal'\n");
  EXPECT_EQ(config.source, SourceType::kReplay);
  EXPECT_EQ(config.replay.file, folder_ / "a.h5") << "relative to the configuration";
  EXPECT_EQ(config.replay.pace, replay::Pace::kAsFastAsPossible);
  EXPECT_EQ(config.camera.address, "10.0.0.2");
  EXPECT_EQ(config.camera.height, 0);
  EXPECT_EQ(config.camera.ir_format, genicam::IrFormat::kTemperatureLinear100mK);
  EXPECT_EQ(config.camera.pixel_order, genicam::PixelOrder::kBigEndian);
  EXPECT_TRUE(config.camera.resend);
  EXPECT_EQ(config.camera.true_rate_hz, 49.5);
  EXPECT_EQ(config.camera.realtime_priority, 10);
  EXPECT_EQ(config.camera.reconnect_after_ms, 0);
  EXPECT_EQ(config.pipeline.deblur.method, deblur::Method::kInverse);
  EXPECT_EQ(config.pipeline.deblur.lambda, 0.5);
  EXPECT_FALSE(config.pipeline.deblur.auto_lambda);
  EXPECT_EQ(config.pipeline.deblur.lookahead, 1);
  EXPECT_EQ(config.pipeline.thread.realtime_priority, 20);
  EXPECT_EQ(config.pipeline.thread.cpus, (std::vector<int>{0, 1}));
  EXPECT_FALSE(config.lock_memory);
  const auto& shared = dynamic_cast<const shm::ShmSection&>(*config.sinks.at(0));
  EXPECT_EQ(shared.describe(config.sink_context()), "shared memory /bolo.front");
  EXPECT_EQ(shared.options().slots, 100);
  EXPECT_EQ(shared.options().mode, 0640U);
  EXPECT_EQ(shared.options().group, "video");
  EXPECT_EQ(config.log.level, spdlog::level::debug);
  EXPECT_EQ(config.log.format, LogFormat::kJournal);
}

TEST_F(Config, TheProfileDecidesUnlessAKeyTakesItsPlace) {
  write("cam.toml",
        "tau_s = 0.009\nframe_period_s = 0.01\nnoise_k = 0.05\nquantisation_k = 0.01\n[transport]\nbyte_order = "
        "'big'\nmetadata_rows = 3\n");
  const auto profile = good("profile = 'cam.toml'\n");
  EXPECT_DOUBLE_EQ(profile.pipeline.deblur.tau_s, 0.009);
  EXPECT_DOUBLE_EQ(profile.camera.rate_hz, 100.0);
  EXPECT_EQ(profile.camera.pixel_order, genicam::PixelOrder::kBigEndian);
  EXPECT_EQ(profile.camera.metadata_rows, 3);
  const auto keys = good(
      "profile = 'cam.toml'\n[source]\npixel_order = 'little'\nmetadata_rows = 0\nrate_hz = 0\n[deblur]\n"
      "tau_s = 0.012\n");
  EXPECT_DOUBLE_EQ(keys.pipeline.deblur.tau_s, 0.012);
  EXPECT_DOUBLE_EQ(keys.camera.rate_hz, 0.0);
  EXPECT_EQ(keys.camera.pixel_order, genicam::PixelOrder::kLittleEndian);
  EXPECT_EQ(keys.camera.metadata_rows, 0);
}

TEST_F(Config, MistakesAreNamed) {
  write("bad.toml", "tau_s = 0.01\ntaus = 1\n");
  write("maps.toml", "maps = 'none.h5'\n");
  const std::string no_name = " is no name for shared memory; use 1 to 200 letters, digits, '-', '_', '.'";
  const std::string no_address = " is no IPv4 address such as 192.168.2.5";
  const std::string lambdas = "0 to 1000000 K (counts when the source has no kelvin), or \"auto\"";
  const std::vector<std::pair<std::string, std::string>> cases{
      {"nmae = 'x'", "bolod.toml:1:1: unknown key 'nmae'; did you mean 'name'?"},
      {"name = 'a b'", "bolod.toml:1:8: name: 'a b'" + no_name},
      {"name = ''", "bolod.toml:1:8: name: ''" + no_name},
      {"profile = 'none.toml'", "bolod.toml:1:11: profile: " + (folder_ / "none.toml").string() + ": no such file"},
      {"profile = 'bad.toml'", "bolod.toml:1:11: profile: " + (folder_ / "bad.toml").string() +
                                   ":2:1: unknown key 'taus'; did you mean 'tau_s'?"},
      {"[source]\ntype = 'disk'",
       "bolod.toml:2:8: source.type = \"disk\" is none of \"genicam\" | \"v4l2\" | \"replay\""},
      {"[source]\ntype = 'replay'",
       "bolod.toml:2:8: source.type = \"replay\" needs source.file, the capture to replay"},
      {"[source]\nwidth = 5000", "bolod.toml:2:9: source.width = 5000 is out of range: 0 to 4096 pixels"},
      {"[source]\nbuffers = 1", "bolod.toml:2:11: source.buffers = 1 is out of range: 4 to 1024 frames"},
      {"[deblur]\nlamda = 1", "bolod.toml:2:1: unknown key 'deblur.lamda'; did you mean 'deblur.lambda'?"},
      {"[deblur]\nlambda = -1", "bolod.toml:2:10: deblur.lambda = -1 is out of range: " + lambdas},
      {"[deblur]\nlambda = 'some'", "bolod.toml:2:10: deblur.lambda must be a number: " + lambdas},
      {"[deblur]\nsolver = 'magic'",
       "bolod.toml:2:10: deblur.solver = \"magic\" is none of \"admm\" | \"dual\" | \"exact\" | \"inverse\" | "
       "\"mmae\" | \"motion\""},
      {"profile = 'maps.toml'", "none.h5: cannot be opened: No such file or directory"},
      {"[deblur]\nworkers = 0", "bolod.toml:2:11: deblur.workers = 0 is out of range: 1 to 64 threads"},
      {"[shm]\nslots = 10",
       "bolod.toml:2:9: shm.slots = 10 is less than window + lookahead = 17; give that or more, or 0"},
      {"[source]\ntype = 'replay'\nfile = 'none.h5'",
       "bolod.toml:3:8: source.file: there is no " + (folder_ / "none.h5").string()},
      {"[source]\naddress = '999.1.2.3'", "bolod.toml:2:11: source.address = \"999.1.2.3\"" + no_address},
      {"[source]\naddress = '192.168.2'", "bolod.toml:2:11: source.address = \"192.168.2\"" + no_address},
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

TEST_F(Config, LambdaMayBeAutomatic) {
  const auto automatic = good("[deblur]\nlambda = 'auto'\nnoise_k = 0.05\nsolver = 'mmae'\n").pipeline.deblur;
  EXPECT_TRUE(automatic.auto_lambda);
  EXPECT_EQ(automatic.noise_k, 0.05);
  EXPECT_EQ(automatic.method, deblur::Method::kMmae);
}

TEST_F(Config, MapsComeWithTheProfile) {
  model::PixelMaps maps;
  maps.geometry = {4, 2};
  maps.gain.assign(8, 1.5F);
  ASSERT_TRUE(capture::write_pixel_maps(folder_ / "maps.h5", maps));
  write("cam.toml", "row_delay_s = 2e-5\nmaps = 'maps.h5'\n");
  const auto config = good("profile = 'cam.toml'\n");
  EXPECT_EQ(config.pipeline.maps.gain, maps.gain);
  EXPECT_EQ(config.pipeline.maps.row_delay_s, 2e-5);
}

TEST_F(Config, WhatDoesNotFitIsNamed) {
  expect_parts(complaint("[deblur]\nwindow = 16\n"), {"window"});
  expect_parts(complaint("[deblur]\nwindow = 5\nlookahead = 4\n"), {"lookahead"});
  const std::string isa = complaint("[deblur]\nisa = 'MMX'\n");
  EXPECT_TRUE(isa.starts_with("bolod.toml:2:7: ")) << isa;
  expect_parts(isa, {"\"MMX\" is not available here; use one of auto, "});
  EXPECT_EQ(good("[deblur]\nisa = 'auto'\n").isa, "auto");
  for (const char* size : {"1", "60", "575"}) {
    expect_parts(complaint(std::string("[source]\npacket_size = ") + size), {"576 bytes or more, or 0"});
  }
  EXPECT_EQ(complaint("[source]\npacket_size = 576\n"), "");
  const std::string no_file_can_have(300, 'n');
  expect_parts(complaint("[source]\ntype = 'replay'\nfile = '" + no_file_can_have + "'\n"), {"there is no"});
}

TEST_F(Config, VideoKeysReachTheirDevices) {
  const auto config =
      must(read("[v4l2]\nenable = true\nformat = 'grey'\nplane = 'raw'\ngain = 'fixed'\nlow_k = 290\nhigh_k = 310\n"
                "[v4l2_second]\nenable = true\ny16_unit = '100mk'\n"));
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
  EXPECT_EQ(tools::test::contents(kShipped), document_config())
      << "config/bolod.toml is out of date: bolod --print-config > it";
}

// --- Keys that a running daemon applies, by comparing two readings of its file.

using Keys = std::vector<std::string>;

class Reload : public Config {};

TEST_F(Reload, TellsLiveKeysFromOthers) {
  const ConfigChange change = compare(good(""), good("[source]\nwidth = 320\n[deblur]\nlambda = 0.5\n[log]\n"
                                                     "level = 'debug'\n[nuc]\nhold_ms = 300\npolicy = 'timed'\n"
                                                     "[v4l2]\nplane = 'raw'\n[v4l2_second]\nlow_k = 200\n"));
  EXPECT_EQ(change.live, (Keys{"log.level", "nuc.hold_ms", "nuc.policy", "v4l2_second.low_k"}));
  EXPECT_EQ(change.restart, (Keys{"deblur.lambda", "source.width", "v4l2.plane"}));
}

TEST_F(Reload, SeesNoChangeInOtherWords) {
  const ConfigChange change =
      compare(good("[nuc]\ninterval_s = 60\n[source]\nwidth = 640\n"), good("[nuc]\ninterval_s = 60.0\n"));
  EXPECT_EQ(change.live, Keys{});
  EXPECT_EQ(change.restart, Keys{});
}

TEST_F(Reload, SeesAKeyWithoutDefaultComeAndGo) {
  EXPECT_EQ(compare(good(""), good("[source]\nrate_hz = 200.0\n")).restart, Keys{"source.rate_hz"});
  EXPECT_EQ(compare(good("[source]\npixel_order = 'big'\n"), good("")).restart, Keys{"source.pixel_order"});
  EXPECT_EQ(compare(good("[source]\npixel_order = 'big'\n"), good("[source]\npixel_order = 'little'\n")).restart,
            Keys{"source.pixel_order"});
}

TEST_F(Reload, SeesAnotherContentOfTheProfile) {
  const std::string text = "profile = 'camera.toml'\n";
  write("camera.toml", "tau_s = 0.011\n");
  const DaemonConfig before = good(text);
  EXPECT_EQ(compare(before, good(text)).restart, Keys{});
  write("camera.toml", "tau_s = 0.012\n");
  EXPECT_EQ(compare(before, good(text)).restart, Keys{"what the profile says"});
}

TEST_F(Reload, EveryLiveKeyExists) {
  const DaemonConfig config = good("");
  for (const std::string& key : live_keys(config)) EXPECT_TRUE(config.texts.contains(key)) << key;
}

// --- State and metrics of sinks, independent of their kind.

class Sinks : public testing::Test {
 protected:
  Sinks() {
    const auto broken = std::make_shared<v4l2::test::FakeDevice>();
    broken->answer = ENODEV;
    for (const char* device : {"/dev/video10", "/dev/video11"}) {
      videos_.push_back(std::make_unique<v4l2::V4l2Sink>(v4l2::V4l2Options{.device = device},
                                                         std::make_unique<v4l2::test::FakePort>(broken, device)));
    }
    pipeline::PipelineOptions options;
    options.workers = 1;
    pipeline_ = std::move(
        *pipeline::Pipeline::create(std::make_unique<pipeline::test::ScriptedSource>(pipeline::test::Script{}),
                                    {&plain_, videos_[0].get(), videos_[1].get()}, options));
  }

  pipeline::test::MemorySink plain_;  // no state of its own
  std::vector<std::unique_ptr<v4l2::V4l2Sink>> videos_;
  std::unique_ptr<pipeline::Pipeline> pipeline_;
  DaemonConfig config_;
};

TEST_F(Sinks, AreInTheState) {
  expect_parts(state_json(config_, *pipeline_),
               {R"("video":[{"device":"/dev/video10","open":true,"written":0,"dropped":0,"failures":0},)"
                R"({"device":"/dev/video11","open":true,"written":0,"dropped":0,"failures":0}]})"});
}

TEST_F(Sinks, ShareTheFamiliesOfTheMetrics) {
  const std::string name = "camera";
  const rt::Gauge<bool> flows{true};
  expect_parts(prometheus::TextSerializer().Serialize(collect_metrics({name, *pipeline_, flows})),
               {"# HELP bolo_video_open 1 while the device takes frames\n"
                "# TYPE bolo_video_open gauge\n"
                "bolo_video_open{device=\"/dev/video10\"} 1\n"
                "bolo_video_open{device=\"/dev/video11\"} 1\n",
                "# TYPE bolo_video_frames_written_total counter\n"
                "bolo_video_frames_written_total{device=\"/dev/video10\"} 0\n"
                "bolo_video_frames_written_total{device=\"/dev/video11\"} 0\n",
                "# HELP bolo_video_frames_dropped_total ", "# HELP bolo_video_failures_total "});
}

TEST_F(Sinks, TellTheirNoticesThroughThePipeline) {
  int patience = 2000;
  plain_.on_publish = [&](const auto& frame, const auto&) {  // by frame 1 the device threads have seen frame 0
    const auto failed = [](const auto& video) { return video->stats().failures.value() > 0; };
    while (frame.meta.frame_id > 0 && !std::ranges::all_of(videos_, failed) && patience-- > 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  };
  const std::atomic<bool> never{false};
  ASSERT_TRUE(pipeline_->run(never));
  const auto notices = pipeline_->take_notices();
  ASSERT_EQ(notices.size(), 2U);
  for (const auto& notice : notices) EXPECT_EQ(notice.event, pipeline::event::kVideoLost);
  EXPECT_TRUE(notices[0].text.starts_with("/dev/video10 takes no more frames")) << notices[0].text;
}

}  // namespace bolo::daemon::config_test
