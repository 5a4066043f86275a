// SPDX-License-Identifier: Apache-2.0
#include <regista/interfaces/messages.hpp>
#include <utility>

namespace regista {

template <Kind kind>
Any<kind>::Any() = default;
template <Kind kind>
Any<kind>::Any(const Any& other) = default;
template <Kind kind>
Any<kind>::Any(Any&& other) noexcept = default;
template <Kind kind>
Any<kind>& Any<kind>::operator=(const Any& other) = default;
template <Kind kind>
Any<kind>& Any<kind>::operator=(Any&& other) noexcept = default;
template <Kind kind>
Any<kind>::~Any() = default;

template class Any<Kind::data>;
template class Any<Kind::command>;
template class Any<Kind::request>;
template class Any<Kind::ack>;

}  // namespace regista
