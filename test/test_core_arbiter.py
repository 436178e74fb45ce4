"""Who has control of a topic, against simulated publishers whose messages are known."""

from collections.abc import Iterator
import dataclasses
import itertools

from hypothesis import assume, given, settings
from hypothesis import strategies as st
import pytest

from ctc_chattering.core.arbiter import Arbiter

MS = 1_000_000
LAPSE = 500 * MS
#: Numbers that are nearer to each other than this may be taken for each other.
NEAR = 4


@dataclasses.dataclass(frozen=True)
class Stream:
    """
    A publisher: message i of its life, i from `first` on, comes at start + (i - first) period.

    Attributes
    ----------
    period, start : int
        [ns].
    first : int
        Number of the first message that is heard.
    count : int
        How many are heard.
    shake : int
        Jitter: every third message is late by so much [ns].

    """

    period: int
    start: int
    first: int
    count: int
    shake: int = 0

    def times(self) -> Iterator[tuple[int, int]]:
        """Yield arrival and number of every message."""
        for k in range(self.count):
            yield (self.start + k * self.period + (self.shake if k % 3 == 1 else 0),
                   self.first + k)


def _several() -> bool:
    return False


def _alone() -> bool:
    return True


def _merged(*streams: Stream) -> list[tuple[int, int, int]]:
    """Return arrival, sender and number of all messages as they come."""
    return sorted((now, who, number) for who, stream in enumerate(streams)
                  for now, number in stream.times())


def _play(arbiter: Arbiter, *streams: Stream) -> list[tuple[int, bool, int]]:
    """Return of all messages who sent it, whether it was taken, and how near the numbers were."""
    ahead = [stream.first for stream in streams]
    rows = []
    for now, who, number in _merged(*streams):
        taken = arbiter.admits(number, now, _several)
        near = abs(ahead[0] - ahead[1])
        ahead[who] = number + 1
        rows.append((who, taken, min(near, abs(ahead[0] - ahead[1]))))
    return rows


@st.composite
def _pairs(draw: st.DrawFn) -> tuple[Stream, Stream]:
    """Return an owner, and an intruder that comes later and not at the owner's number."""
    def stream(start: int) -> Stream:
        period = draw(st.integers(MS // 2, 20 * MS))
        return Stream(period, start, draw(st.integers(1, 400)), draw(st.integers(10, 400)),
                      draw(st.integers(0, period // 4)))

    owner = stream(0)
    intruder = stream(draw(st.integers(1, 500 * MS)))
    said = sum(now < intruder.start for now, _ in owner.times())
    assume(said < owner.count)
    assume(abs(owner.first + said - intruder.first) > NEAR)
    return owner, intruder


def _while_it_speaks(owner: Stream, intruder: Stream) -> tuple[Stream, Stream]:
    """Return the two with an intruder that ends where the owner does."""
    last = max(now for now, _ in owner.times())
    endless = dataclasses.replace(intruder, count=last // intruder.period + 1)
    return owner, dataclasses.replace(
        intruder, count=sum(now < last for now, _ in endless.times()))


@settings(max_examples=100)
@given(_pairs(), st.booleans())
def test_the_owner_keeps_control_as_long_as_it_speaks(
        pair: tuple[Stream, Stream], trusting: bool) -> None:
    """
    Check every message of random rates, starts and jitter, the numbers crossing or not.

    Where they are apart, all of the owner's are taken and none of the intruder's. Where they
    meet, a trusting arbiter may take a wrong one, and another may lose some.
    """
    for who, taken, near in _play(Arbiter(LAPSE, trusting), *_while_it_speaks(*pair)):
        if near >= NEAR:
            assert taken == (who == 0)
        elif not trusting and who == 1:
            assert not taken


@pytest.mark.parametrize('trusting', [False, True])
@pytest.mark.parametrize(('owner', 'intruder'), [
    (Stream(10 * MS, 0, 1, 300), Stream(4 * MS, 505 * MS, 1, 500)),
    (Stream(4 * MS, 0, 1, 600), Stream(10 * MS, 105 * MS, 100, 200))])
def test_numbers_that_cross(owner: Stream, intruder: Stream, trusting: bool) -> None:
    """Check a faster intruder that comes from behind and a slower one that is caught up with."""
    rows = _play(Arbiter(LAPSE, trusting), owner, intruder)
    met = [k for k, (_, _, near) in enumerate(rows) if near < NEAR]
    assert 0 < len(met) < 25
    ends = [(who, taken) for who, taken, _ in rows[met[-1] + 1:]]
    assert {who for who, taken in ends if taken} == {0}
    assert all(taken for who, taken in ends if who == 0)
    assert sum(taken for who, taken, _ in rows if who == 1) <= 5 * trusting
    assert sum(not taken for who, taken, _ in rows if who == 0) <= 5


def test_first_overtaking_and_then_overtaken() -> None:
    """Check that who is ahead is decided anew at every meeting: by who came from behind."""
    owner = Stream(10 * MS, 0, 1, 300)
    slow, fast = Stream(25 * MS, MS, 50, 60), Stream(4 * MS, 1501 * MS, 100, 300)
    arbiter, lost = Arbiter(LAPSE, False), 0
    for now, who, number in _merged(owner, slow, fast):
        taken = arbiter.admits(number, now, _several)
        assert not taken or who == 0
        lost += who == 0 and not taken
    assert 0 < lost < 15
    assert taken == (who == 0)


def test_those_who_have_gone_are_forgotten() -> None:
    """Check that being alone clears the number of an intruder; without that it costs messages."""
    for gone in (True, False):
        arbiter = Arbiter(LAPSE, False)
        assert arbiter.admits(1, 0, _several)
        assert not arbiter.admits(10, 0, _several)
        assert arbiter.admits(2, 1, _several)
        if gone:
            assert arbiter.admits(5, 2, _alone)
        else:
            for number in (3, 4, 5):
                assert arbiter.admits(number, 2, _several)
        taken = [arbiter.admits(number, number, _several) for number in range(6, 20)]
        assert all(taken) == gone
        assert taken.count(False) <= 2


@pytest.mark.parametrize('trusting', [False, True])
def test_two_that_stay_level(trusting: bool) -> None:
    """Check equal numbers at equal rates for longer than the lapse: nobody is heard, or both."""
    arbiter = Arbiter(LAPSE, trusting)
    assert arbiter.admits(1, 0, _several)
    assert not arbiter.admits(1, 0, _several)
    for number in range(2, 2000):
        assert arbiter.admits(number, number * MS, _several) == trusting
        assert arbiter.admits(number, number * MS, _several) == trusting


@pytest.mark.parametrize('period', [4 * MS, 9 * MS, 25 * MS])
def test_an_intruder_that_begins_at_the_owner_s_number(period: int) -> None:
    """Check what cannot be told apart: it takes over, for good or for a message or two."""
    owner = Stream(10 * MS, 0, 1, 300)
    rows = _play(Arbiter(LAPSE, False), owner, Stream(period, 495 * MS, 51, 60))
    heard = [who for who, taken, _ in rows if taken]
    assert heard[:51] == [0] * 50 + [1]
    assert sum(a != b for a, b in itertools.pairwise(heard)) <= 2  # To it and back.


@pytest.mark.parametrize(('silence', 'taken'), [(LAPSE, False), (LAPSE + 1, True)])
def test_takeover_after_the_lapse(silence: int, taken: bool) -> None:
    """Check both sides of the lapse, and that control then stays where it went."""
    arbiter = Arbiter(LAPSE, False)
    for k in range(10):
        assert arbiter.admits(1 + k, k * MS, _several)
        assert not arbiter.admits(100 + k, k * MS, _several)
    now = 9 * MS + silence
    assert arbiter.admits(110, now, _several) == taken
    for k in range(1, 20):
        assert arbiter.admits(10 + k, now, _several) != taken
        assert arbiter.admits(110 + k, now + k * MS, _several) == taken


@given(_pairs())
def test_one_of_two_that_ends(pair: tuple[Stream, Stream]) -> None:
    """Check that the other one has control soon after, wherever the numbers meet."""
    last = [max(now for now, _ in stream.times()) for stream in pair]
    for who in (0, 1):
        longer = [stream if i != who else dataclasses.replace(
            stream, count=stream.count + (last[1 - i] + 3 * LAPSE) // stream.period)
            for i, stream in enumerate(pair)]
        rows = _play(Arbiter(LAPSE, False), *longer)
        assert {sender for sender, _, _ in rows[-5:]} == {who}
        assert any(taken for _, taken, _ in rows[-5:])  # All, but where it meets a number left.


def test_a_pause_of_the_owner_is_forgiven() -> None:
    """Check that after any silence it goes on with its number, as nobody took over."""
    arbiter = Arbiter(LAPSE, False)
    assert arbiter.admits(7, 0, _several)
    assert arbiter.admits(8, 100 * LAPSE, _several)
    assert not arbiter.admits(20, 100 * LAPSE, _several)


@pytest.mark.parametrize('trusting', [False, True])
def test_alone_everything_is_taken(trusting: bool) -> None:
    """Check lost messages, a restart, and a message after an intruder has gone."""
    arbiter = Arbiter(LAPSE, trusting)
    for k, number in enumerate((5, 6, 9, 1, 2, 2, 100)):
        assert arbiter.admits(number, k, _alone)
    for number in (300, 301, 302):
        assert not arbiter.admits(number, 10, _several)
    for number in range(101, 400):
        assert arbiter.admits(number, number, _alone)


def test_alone_is_asked_in_doubt_only() -> None:
    """Check that the owner's messages, one after the other, cost no question."""
    arbiter, asked = Arbiter(LAPSE, False), []

    def alone() -> bool:
        asked.append(1)
        return False

    for number in range(1, 100):
        assert arbiter.admits(number, number, alone)
    assert not asked
    arbiter.admits(1, 100, alone)
    assert len(asked) == 1


@pytest.mark.parametrize('trusting', [False, True])
def test_without_numbers(trusting: bool) -> None:
    """Check that nobody is heard while there are several, and the only one always."""
    arbiter = Arbiter(LAPSE, trusting)
    for now in (0, 1, 2 * LAPSE):
        assert not arbiter.admits(None, now, _several)
        assert arbiter.admits(None, now, _alone)
        arbiter.pass_over(None, 0)
    assert arbiter.admits(1, 3 * LAPSE, _several)
    assert not arbiter.admits(None, 3 * LAPSE, _several)
    assert arbiter.admits(2, 3 * LAPSE, _several)


@settings(max_examples=100)
@given(_pairs(), st.lists(st.booleans(), min_size=1, max_size=50), st.booleans())
def test_messages_that_concern_nobody(
        pair: tuple[Stream, Stream], ours: list[bool], foreign: bool) -> None:
    """
    Check an owner some of whose messages are passed over, and a publisher all of whose are.

    Neither ever costs a message of the owner's that concerns us, even where the numbers cross.
    """
    arbiter, first = Arbiter(LAPSE, False), True
    for now, who, number in _merged(*pair):
        if who == 1:
            if foreign:
                arbiter.pass_over(number, now)
        elif first or foreign or ours[number % len(ours)]:
            assert arbiter.admits(number, now, _several)
            first = False
        else:
            arbiter.pass_over(number, now)


@settings(max_examples=200)
@given(_pairs(), st.lists(st.sampled_from(('ours', 'over', 'bytes')), min_size=1, max_size=50),
       st.lists(st.sampled_from(('ours', 'over')), min_size=1, max_size=20))
def test_what_messages_say_settles_every_doubt(
        pair: tuple[Stream, Stream], kinds: list[str], mine: list[str]) -> None:
    """
    Check an intruder that also sends what nobody can read and what concerns nobody.

    It is first heard at none of the numbers that the owner's next message may have: such a one
    raises no doubt, see `test_an_intruder_that_begins_at_the_owner_s_number`.
    """
    arbiter, first, alone = Arbiter(LAPSE, True), True, True
    heard = last = used = 0
    for now, who, number in _merged(*_while_it_speaks(*pair)):
        kind = kinds[number % len(kinds)] if who else mine[number % len(mine)]
        if (first and (who or kind != 'ours')) or now - heard > LAPSE:
            continue
        first = False
        if who and alone:
            assume(not used < number <= last + 1)
            alone = False
        elif not who:
            last, used = number, number if kind == 'ours' else used
        if kind == 'over':
            arbiter.pass_over(number, now)
        elif kind == 'bytes':
            arbiter.reject(number, now, _several)
        else:
            honest = who == 0
            taken = arbiter.admits(
                number, now, _several, lambda it=honest: it)  # type: ignore[misc]
            assert taken == honest, (now, who, number)
        if who == 0 and kind == 'ours':
            heard = now


def test_passing_over_is_no_pardon() -> None:
    """Check that a gap is bridged only as far as its messages were passed over."""
    arbiter = Arbiter(LAPSE, False)
    assert arbiter.admits(1, 0, _several)
    for number in (2, 3, 5):
        arbiter.pass_over(number, 1)
    assert not arbiter.admits(6, 1, _several)
    assert not arbiter.admits(5, 1, _several)
    assert arbiter.admits(4, 1, _several)
    assert not arbiter.admits(1, 1, _several)
    assert arbiter.admits(5, 1, _several)


def test_many_intruders() -> None:
    """Check twenty at once, far from the owner: none is heard, and the owner always is."""
    arbiter = Arbiter(LAPSE, False)
    for k in range(300):
        assert arbiter.admits(1 + k, k * MS, _several)
        for who in range(1, 21):
            assert not arbiter.admits(1000 * who + k, k * MS, _several)
    remembered: dict[int, None] = getattr(arbiter, '_others')  # noqa: B009
    assert len(remembered) <= 16


def test_one_that_has_gone_costs_the_owner_nothing() -> None:
    """The owner's numbers meet those that another one would have sent next, long ago."""
    arbiter = Arbiter(500 * MS, trusting=False)
    now = 0
    for k in range(1, 3):
        assert arbiter.admits(k, now, lambda: False)
    for k in range(40, 50):
        assert not arbiter.admits(k, now, lambda: False)
    for k in range(3, 100):
        now += 20 * MS
        assert arbiter.admits(k, now, lambda: False)
