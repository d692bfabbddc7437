// `bolo fakecam`: serves a capture as a GigE Vision camera.
#include <chrono>
#include <cstdio>
#include <iostream>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "drivers/fakecam/fake_camera.hpp"
#include "drivers/fakecam/gige_vision.hpp"
#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

using fakecam::FakeCamera;
using fakecam::FakeCameraOptions;
using fakecam::FakeCameraStats;

constexpr double kShortestReport_s = 0.05;

struct FakeCameraRequest {
  std::string capture;
  FakeCameraOptions camera;
  double tell_every_s = 0.0;  // 0: only at the end
  bool once = false;
  bool json = false;
};

cxxopts::Options fakecam_options() {
  cxxopts::Options options("bolo fakecam",
                           "Serve a capture as a GigE Vision camera with the features of a FLIR A655sc.\n");
  options.positional_help("CAPTURE").show_positional_help();
  add_option<std::string>(options, "capture", "Capture to replay (.h5, or the authors' .mat)");
  add_option<double>(options, "rate",
                     "Frames per second, with time stamps 1/RATE apart (default: the capture's times)");
  add_option<bool>(options, "loop", "Repeat endlessly; frame ids and times continue across the seam");
  add_option<std::uint64_t>(options, "repeat", "Serve the capture N times per stream");
  add_option<bool>(options, "once", "Exit after the first stream that reaches its last frame");
  add_option<std::string>(options, "interface", "The camera's IP address; any of 127.0.0.0/8 works", "127.0.0.1");
  add_option<std::string>(options, "serial", "Serial number, at most 15 characters (default: the capture's)");
  add_option<std::vector<int>>(options, "crop", "x,y,w,h: part of the capture used as the sensor");
  add_option<std::string>(options, "fault", "Fault to inject, with its times; repeatable", nullptr,
                          "NAME[:key=value,...]");
  add_option<bool>(options, "list-faults", "Print all faults with their keys, and exit");
  add_option<double>(options, "tell-every", "Print statistics every S seconds", nullptr, "S");
  add_option<bool>(options, "json", "Print the lines as JSON");
  options.parse_positional({"capture"});
  return options;
}

Result<fakecam::FaultScript> read_faults(const cxxopts::ParseResult& parsed) {
  fakecam::FaultScript script;
  for (const auto& argument : parsed.arguments()) {
    if (argument.key() != "fault") continue;
    ASSIGN_OR_RETURN(auto fault, at("--fault", fakecam::parse_fault(argument.value())));
    script.push_back(std::move(fault));
  }
  return script;
}

Result<FakeCameraRequest> fakecam_request(const cxxopts::ParseResult& parsed) {
  FakeCameraRequest request;
  if (parsed.count("capture") == 0) return bad_input("no CAPTURE given; see bolo fakecam --help");
  request.capture = parsed["capture"].as<std::string>();
  request.once = parsed.count("once") != 0;
  request.json = parsed.count("json") != 0;
  auto& camera = request.camera;
  camera.address = parsed["interface"].as<std::string>();
  if (parsed.count("serial") != 0) camera.serial = parsed["serial"].as<std::string>();
  if (parsed.count("rate") != 0) {
    camera.rate_hz = parsed["rate"].as<double>();
    if (!(camera.rate_hz > 0.0)) return bad_input("--rate must be above 0 frames a second");
  }
  if (parsed.count("tell-every") != 0) {
    request.tell_every_s = parsed["tell-every"].as<double>();
    if (!(request.tell_every_s >= kShortestReport_s)) return bad_input("--tell-every must be at least 0.05 s");
  }
  const bool loops = parsed.count("loop") != 0;
  if (parsed.count("repeat") != 0) {
    if (loops) return bad_input("--loop and --repeat exclude each other; --loop repeats for ever");
    camera.laps = parsed["repeat"].as<std::uint64_t>();
    if (camera.laps == 0) return bad_input("--repeat must be at least 1; --loop repeats for ever");
  }
  if (loops && request.once) return bad_input("--loop never ends, so --once can't end it; use --repeat N --once");
  if (loops) camera.laps = 0;
  if (parsed.count("crop") != 0) {
    const auto crop = parsed["crop"].as<std::vector<int>>();
    if (crop.size() != 4) return bad_input("--crop takes four numbers: x,y,width,height, for example 0,196,640,120");
    camera.crop = Region{crop[0], crop[1], crop[2], crop[3]};
  }
  ASSIGN_OR_RETURN(camera.faults, read_faults(parsed));
  return request;
}

void print_serving(const FakeCameraRequest& request, const FakeCamera& camera) {
  const Geometry sensor = camera.sensor();
  if (request.json) {
    const nlohmann::json line{{"serving", request.camera.address},
                              {"port", fakecam::gvcp::kPort},
                              {"serial", camera.serial()},
                              {"width", sensor.width},
                              {"height", sensor.height},
                              {"rate_hz", camera.rate_hz()},
                              {"broadcast", camera.hears_broadcasts()}};
    std::cout << json_text(line) << std::endl;
    return;
  }
  std::printf("serving %s as camera %s at %s:%u, %dx%d, %g frames/s%s\n", printable(request.capture).c_str(),
              printable(camera.serial()).c_str(), request.camera.address.c_str(), fakecam::gvcp::kPort, sensor.width,
              sensor.height, camera.rate_hz(),
              camera.hears_broadcasts() ? "" : " (found by its address only: another program holds the broadcasts)");
  std::fflush(stdout);
}

nlohmann::json to_json(const std::vector<fakecam::InjectedFault>& injected) {
  nlohmann::json all = nlohmann::json::array();
  for (const auto& fault : injected) {
    all.push_back(
        {{"fault", fault.fault}, {"times", fault.times}, {"frames", fault.frames}, {"packets", fault.packets}});
  }
  return all;
}

void print_summary(const FakeCameraRequest& request, const FakeCameraStats& stats,
                   const std::vector<fakecam::InjectedFault>& injected) {
  const double worst_ms = static_cast<double>(stats.worst_lateness_ns) * 1e-6;
  if (request.json) {
    const nlohmann::json line{{"time_ns", monotonic_ns()},
                              {"first_stream_ns", stats.first_stream_ns},
                              {"frames_passed", stats.position.turns},
                              {"last_timestamp_ns", stats.position.timestamp_ns},
                              {"frames_sent", stats.frames_sent},
                              {"packets_sent", stats.packets_sent},
                              {"send_errors", stats.send_errors},
                              {"late_frames", stats.late_frames},
                              {"worst_lateness_ms", worst_ms},
                              {"resend_requests", stats.resend_requests},
                              {"resent_packets", stats.resent_packets},
                              {"resend_misses", stats.resend_misses},
                              {"commands", stats.commands},
                              {"bad_commands", stats.bad_commands},
                              {"clients", stats.clients},
                              {"heartbeat_losses", stats.heartbeat_losses},
                              {"streams_started", stats.streams_started},
                              {"streams_finished", stats.streams_finished},
                              {"nuc_actions", stats.nuc_actions},
                              {"faults", to_json(injected)}};
    std::cout << json_text(line) << std::endl;
    return;
  }
  const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  std::printf(
      "sent %llu frames in %llu packets to %llu client(s); %llu frames late (worst %.1f ms), %llu packets refused by "
      "the "
      "socket; %llu resend requests, %llu packets sent again, %llu requests in vain\n",
      n(stats.frames_sent), n(stats.packets_sent), n(stats.clients), n(stats.late_frames), worst_ms,
      n(stats.send_errors), n(stats.resend_requests), n(stats.resent_packets), n(stats.resend_misses));
  for (const auto& fault : injected) {
    std::printf("fault %s: struck %llu time(s), %llu frames, %llu packets\n", fault.fault.c_str(), n(fault.times),
                n(fault.frames), n(fault.packets));
  }
}

void wait_for_end(const FakeCameraRequest& request, const FakeCamera& camera) {
  const auto period_ns = static_cast<std::int64_t>(request.tell_every_s * kNsPerSecond);
  std::int64_t next_report_ns = monotonic_ns() + period_ns;
  while (!interrupted().load(std::memory_order_relaxed)) {
    if (period_ns > 0 && monotonic_ns() >= next_report_ns) {
      print_summary(request, camera.stats(), camera.injected());
      next_report_ns += period_ns;
    }
    if (request.once && camera.stats().streams_finished > 0) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

Status run_fakecam(const cxxopts::ParseResult& given) {
  if (given.count("list-faults") != 0) {
    print_faults(given.count("json") != 0);
    return {};
  }
  ASSIGN_OR_RETURN(const auto request, fakecam_request(given));
  ASSIGN_OR_RETURN(auto provider, fakecam::open_capture(request.capture));
  ASSIGN_OR_RETURN(const auto camera, FakeCamera::start(request.camera, std::move(provider)));
  print_serving(request, *camera);
  wait_for_end(request, *camera);
  camera->stop();
  print_summary(request, camera->stats(), camera->injected());
  return camera->result();
}

}  // namespace

int fakecam_main(int argc, char** argv) { return run_verb("fakecam", fakecam_options(), argc, argv, run_fakecam); }

}  // namespace bolo::tools
