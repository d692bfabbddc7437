// `bolo recover`: saves an interrupted recording or a damaged capture as a valid capture.
#include <cstdio>
#include <iostream>
#include <memory>

#include <nlohmann/json.hpp>

#include "src/capture/capture.hpp"
#include "src/core/text.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

struct RecoverRequest {
  std::filesystem::path damaged;
  OutputFile out;
  bool in_place = false;
};

cxxopts::Options recover_options() {
  cxxopts::Options options("bolo recover",
                           "Save the frames of an interrupted recording (FILE.h5.part) or a damaged capture. The file "
                           "itself stays unchanged unless --in-place is given.\n");
  options.positional_help("FILE").show_positional_help();
  add_option<std::string>(options, "file", ".part of an interrupted recording, or a capture that does not open");
  add_option<std::string>(options, "o,output", "Capture to write (default: FILE without .part)");
  add_option<bool>(options, "in-place", "Finish and rename the .part itself: no copy, no extra disk space");
  add_option<bool>(options, "json", "Print the outcome as JSON");
  add_overwrite_option(options);
  options.parse_positional({"file"});
  return options;
}

Result<RecoverRequest> recover_request(const cxxopts::ParseResult& parsed) {
  if (parsed.count("file") == 0) return bad_input("which file? usage: bolo recover FILE.h5.part [-o OUT.h5]");
  RecoverRequest request;
  request.damaged = parsed["file"].as<std::string>();
  request.in_place = parsed.count("in-place") != 0;
  const bool part = request.damaged.extension() == ".part";
  if (request.in_place && !part) return bad_input("--in-place is for a .part; save this file to another one with -o");
  if (parsed.count("output") != 0) {
    request.out.path = parsed["output"].as<std::string>();
  } else if (part) {
    request.out.path = request.damaged.parent_path() / request.damaged.stem();
  } else {
    return bad_input("where to? usage: bolo recover " + request.damaged.string() + " -o OUT.h5");
  }
  request.out.replace = replace_of(parsed);
  // The damaged file may be the output's ".part": no conflict, it stays unchanged or is renamed to the output.
  const bool itself = request.damaged == std::filesystem::path(request.out.path.string() + ".part");
  const std::vector<std::filesystem::path> inputs{itself ? std::filesystem::path() : request.damaged};
  RETURN_IF_ERROR(check_outputs({request.out.path}, inputs, request.out.replace));
  return request;
}

nlohmann::json to_json(const RecoverRequest& request, const capture::Recovered& done) {
  return {{"file", request.damaged.string()},
          {"output", request.out.path.string()},
          {"frames", done.frames},
          {"seconds", done.last_t_s - done.first_t_s},
          {"last_t_s", done.last_t_s},
          {"unreadable", done.unreadable},
          {"missing", done.remarks}};
}

void print(const RecoverRequest& request, const capture::Recovered& done) {
  std::printf("%s: %llu frames saved, %.3f s, the last at %.6f s\n", printable(request.out.path.string()).c_str(),
              static_cast<unsigned long long>(done.frames), done.last_t_s - done.first_t_s, done.last_t_s);
  if (done.unreadable > 0) {
    std::printf("missing: %llu frames in between cannot be read\n", static_cast<unsigned long long>(done.unreadable));
  }
  for (const std::string& remark : done.remarks) std::printf("missing: %s\n", printable(remark).c_str());
  if (!request.in_place) std::printf("%s is as it was\n", printable(request.damaged.string()).c_str());
}

Result<capture::Recovered> recover(const RecoverRequest& request) {
  if (request.in_place) return capture::recover_in_place(request.damaged, request.out);
  std::unique_ptr<Progress> progress;
  return capture::recover_copy(request.damaged, request.out, [&](std::uint64_t frames, std::uint64_t of) {
    if (!progress) progress = std::make_unique<Progress>("recovering", of);
    progress->update(frames);
    return !interrupted().load(std::memory_order_relaxed);
  });
}

Status run_recover(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const auto request, recover_request(given));
  ASSIGN_OR_RETURN(const auto done, recover(request));
  if (given.count("json") != 0) {
    std::cout << json_text(to_json(request, done)) << '\n';
  } else {
    print(request, done);
  }
  return {};
}

}  // namespace

int recover_main(int argc, char** argv) { return run_verb("recover", recover_options(), argc, argv, run_recover); }

}  // namespace bolo::tools
