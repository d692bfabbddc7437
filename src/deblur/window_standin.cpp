#include <cmath>
#include "bolo/deblur/window.hpp"
namespace bolo::deblur {
struct Window::Impl {
  int n, look; std::int64_t period;
  std::vector<WindowFrame> ring; std::vector<char> has;  // grid entries, newest last
  std::vector<const void*> planes; std::vector<std::uint32_t> rel; std::vector<std::uint32_t> rel_out;
  std::vector<WindowFrame> waiting; int span = 0; bool done = false; std::vector<WindowFrame> old; std::size_t old_at=0;
  std::int64_t last_ns = 0;
};
Window::Window(const Settings& s) : impl_(std::make_shared<Impl>()) {
  auto& m = *impl_; m.n = s.window; m.look = s.lookahead; m.period = std::llround(s.period_s * 1e9);
  m.ring.resize(std::size_t(m.n)); m.has.resize(std::size_t(m.n)); m.planes.resize(std::size_t(m.n));
  m.rel.reserve(200); m.rel_out.reserve(200); m.waiting.reserve(100); m.old.reserve(100);
}
int Window::slots() const noexcept { return impl_->n * 2; }
bool Window::push(const WindowFrame& f, bool restart) noexcept {
  auto& m = *impl_;
  bool emptied = false;
  std::int64_t steps = m.span ? std::llround(double(f.meta.camera_ns - m.last_ns) / double(m.period)) : 1;
  m.old.clear(); m.old_at = 0;
  if (m.span && (restart || steps < 1 || steps >= m.n)) {
    emptied = true;
    for (auto& w : m.waiting) m.old.push_back(w);
    m.waiting.clear();
    for (int i = 0; i < m.n; ++i) { if (m.has[std::size_t(i)]) m.rel.push_back(m.ring[std::size_t(i)].token); m.has[std::size_t(i)] = 0; }
    m.span = 0; steps = 1;
  }
  for (std::int64_t k = 0; k < steps; ++k) {
    if (m.has[0]) m.rel.push_back(m.ring[0].token);
    for (std::size_t i = 0; i + 1 < std::size_t(m.n); ++i) { m.ring[i] = m.ring[i + 1]; m.has[i] = m.has[i + 1]; }
    m.has[std::size_t(m.n) - 1] = 0;
    ++m.span;
  }
  m.ring.back() = f; m.has.back() = 1; m.last_ns = f.meta.camera_ns; m.waiting.push_back(f);
  return emptied;
}
void Window::finish() noexcept { auto& m = *impl_; for (auto& w : m.waiting) m.old.push_back(w); m.waiting.clear(); }
bool Window::next(Ready& r) noexcept {
  auto& m = *impl_;
  if (m.old_at < m.old.size()) { r.frame = m.old[m.old_at++]; r.frame.meta.flags |= kFlagWarmUp; r.full = false; return true; }
  if (m.waiting.empty()) return false;
  WindowFrame f = m.waiting.front();
  const std::int64_t age = std::llround(double(m.last_ns - f.meta.camera_ns) / double(m.period));
  if (age < m.look) return false;
  m.waiting.erase(m.waiting.begin());
  r.frame = f; r.full = m.span >= m.n && age == m.look;
  bool gap = false;
  for (std::size_t i = 0; i < std::size_t(m.n); ++i) { m.planes[i] = m.has[i] ? m.ring[i].plane : nullptr; gap |= r.full && !m.has[i]; }
  r.view = {m.planes, m.n - 1 - m.look};
  if (!r.full) r.frame.meta.flags |= kFlagWarmUp;
  if (gap) r.frame.meta.flags |= kFlagGap;
  return true;
}
std::span<const std::uint32_t> Window::released() noexcept { auto& m = *impl_; m.rel_out.swap(m.rel); m.rel.clear(); return m.rel_out; }
}
