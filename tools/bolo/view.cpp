// `bolo view`: a live page of a running daemon's frames.
#include <unistd.h>

#include <algorithm>
#include <climits>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/shm/followed_stream.hpp"
#include "drivers/shm/shm_object.hpp"
#include "src/core/ip_address.hpp"
#include "tools/bolo/control_client.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/view/site.hpp"

namespace bolo::tools {
namespace {

struct ViewOptions {
  std::vector<std::string> names;
  int port = 8640;
  std::string listen;
  std::string token;
  std::string token_file;
  std::string page;
  bool json = false;
};

// All running daemons if none is named.
Result<std::vector<std::string>> choose_daemons(const std::vector<std::string>& named) {
  for (const std::string& name : named) {
    RETURN_IF_ERROR(shm::object_path(name));
    if (std::count(named.begin(), named.end(), name) > 1) return bad_input(name + " is named twice");
  }
  if (!named.empty()) return named;
  std::vector<std::string> names = shm::object_names();
  const auto ended = [](const std::string& name) {
    const auto stream = shm::FollowedStream::open(name, 0);
    return !stream || stream->reader().closed();
  };
  if (names.size() > 1) std::erase_if(names, ended);
  if (names.empty()) return bad_input("no daemon runs here; start bolod, or name the one to wait for: bolo view NAME");
  return names;
}

Result<view::Access> access_of(const ViewOptions& options) {
  view::Access access;
  const auto listen = ip_address(options.listen);
  if (!options.listen.empty() && !listen) {
    return bad_input("--listen '" + options.listen +
                     "': give an IP address of this computer, such as 127.0.0.1; the port is --port");
  }
  access.beyond_loopback = listen && !listen->loopback;
  access.token = options.token;
  if (!options.token.empty() && !options.token_file.empty()) {
    return bad_input("--token and --token-file exclude each other");
  }
  if (!options.token_file.empty()) {
    ASSIGN_OR_RETURN(access.token, view::read_token(options.token_file));
  }
  if (!access.token.empty()) {
    RETURN_IF_ERROR(view::check_token(access.token));
  }
  if (access.beyond_loopback && access.token.empty()) {
    return bad_input("--listen " + options.listen +
                     " lets other computers in: give --token TOKEN or --token-file FILE");
  }
  if (access.token.empty()) {
    ASSIGN_OR_RETURN(access.token, view::random_token());
  }
  char host_name[HOST_NAME_MAX + 1] = {};
  if (gethostname(host_name, sizeof host_name - 1) == 0) access.host_name = host_name;
  return access;
}

std::string url_of(const ViewOptions& options, const view::Access& access) {
  std::string host = options.listen.empty() ? "localhost" : options.listen;
  if (host == "0.0.0.0" || host == "::") host = access.host_name;
  if (host.find(':') != std::string::npos) host = "[" + host + "]";
  // Does not print a given token: it stays valid, and output ends up in logs. A generated one is for this run only.
  const bool given = !options.token.empty() || !options.token_file.empty();
  return "http://" + host + ":" + std::to_string(access.port) + "/?token=" + (given ? "TOKEN" : access.token);
}

void print_addresses(const ViewOptions& options, const std::string& name, const std::string& url) {
  if (options.json) {
    std::puts(nlohmann::ordered_json{{"url", url}, {"name", name}}.dump().c_str());
  } else {
    std::printf("%s at %s\nCtrl-C ends it\n", name.c_str(), url.c_str());
  }
  std::fflush(stdout);
}

Status view_daemon(const ViewOptions& options) {
  RETURN_IF_ERROR(within(options.port, "port", 0, UINT16_MAX));  // before the conversion drops the upper bits
  std::error_code ignored;
  if (!options.page.empty() && !std::filesystem::is_directory(options.page, ignored)) {
    return bad_input("--page " + options.page + ": there is no such folder");
  }
  ASSIGN_OR_RETURN(const std::vector<std::string> names, choose_daemons(options.names));
  ASSIGN_OR_RETURN(view::Access access, access_of(options));
  const auto addresses =
      options.listen.empty() ? std::vector<std::string>{"127.0.0.1", "::1"} : std::vector<std::string>{options.listen};
  ASSIGN_OR_RETURN(const auto server, view::HttpServer::listen(addresses, static_cast<std::uint16_t>(options.port), {},
                                                               view::Site::headers()));
  access.port = server->port();
  std::vector<std::unique_ptr<view::LiveStream>> streams;
  std::vector<view::LiveStream*> lent;
  for (const std::string& name : names) {
    streams.push_back(std::make_unique<view::LiveStream>(name, [&server] { server->wake(); }));
    lent.push_back(streams.back().get());
  }
  const auto ask_for_nuc = [](const std::string& name) -> Status {
    const Result<std::string> answer = ask_daemon_named(name, "nuc");
    return answer ? judge_answer(*answer) : tl::unexpected<Error>(answer.error());
  };
  view::Site site(access, lent, ask_for_nuc, options.page);
  print_addresses(options, fmt::format("{}", fmt::join(names, ", ")), url_of(options, access));
  server->run([&site](const view::Request& request) { return site.answer(request); }, interrupted());
  return {};
}

}  // namespace

int view_main(int argc, char** argv) {
  cxxopts::Options cli("bolo view",
                       "Serve a live page of a running daemon: blurred, deblurred, traces, rates, losses.");
  ViewOptions options;
  auto add = cli.add_options();
  add("name", "Daemons' names (default: all that run); several are shown side by side",
      cxxopts::value<std::vector<std::string>>());
  add("port", "TCP port; 0: any that is free", cxxopts::value(options.port)->default_value("8640"));
  add("listen", "IP address to serve on instead of 127.0.0.1 and ::1; one that other computers reach needs a token",
      cxxopts::value(options.listen), "ADDRESS");
  add("token", "Token that opens the page, as ?token=TOKEN (other users can see it); default: a random one, printed",
      cxxopts::value(options.token), "TOKEN");
  add("token-file", "Token from the first line of a file", cxxopts::value(options.token_file), "FILE");
  add("json", "Print {\"url\": ...} when ready", cxxopts::value(options.json));
  add("page", "Serve the page's files from this folder, for development", cxxopts::value(options.page), "FOLDER");
  cli.parse_positional({"name"});
  cli.positional_help("[NAME...]");
  return run_verb("view", std::move(cli), argc, argv, [&options](const cxxopts::ParseResult& given) {
    options.names = names_of(given, "name");
    return view_daemon(options);
  });
}

}  // namespace bolo::tools
