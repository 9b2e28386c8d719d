"""Passwords, sessions and tokens of a folder, without a server."""

import json
import re
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from app.access.access import Access, Kind
from app.access.attempts import Attempts
from app.access.keys import OneTimeKeys
from app.access.password import Hashing, made_password
from app.access.state import FILE, MOST_SESSIONS
from app.errors import (
    AccessFileError,
    KeyRefused,
    NoPassword,
    NotThere,
    OptionError,
    PasswordUnfit,
    TooManyAttempts,
    WrongPassword,
)

CHEAP = Hashing(memory_kib=64, passes=1)
PASSWORD = "a turntable and a laser"


class Clock:
    now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def access(tmp_path: Path) -> Access:
    access = Access.open(tmp_path, hashing=CHEAP)
    access.set_password(PASSWORD)
    return access


def test_without_a_password_nobody_logs_in(tmp_path: Path) -> None:
    access = Access.open(tmp_path / "not yet there", hashing=CHEAP)
    assert access.is_open()
    assert not access.has_password
    with pytest.raises(NoPassword):
        access.log_in(PASSWORD, "10.0.0.1", "Firefox")
    with pytest.raises(NoPassword):
        access.make_token("script")
    assert access.let_in_by_cookie("") is None


def test_who_knows_the_password_gets_a_session_until_he_logs_out(access: Access) -> None:
    secret = access.log_in(PASSWORD, "10.0.0.1", "Firefox on Linux")
    held = access.let_in_by_cookie(secret)
    assert held is not None
    assert held.kind is Kind.SESSION
    assert [each.browser for each in access.sessions()] == ["Firefox on Linux"]
    with pytest.raises(WrongPassword):
        access.log_in(PASSWORD + "!", "10.0.0.1", "Firefox")
    access.log_out(held)
    assert access.let_in_by_cookie(secret) is None
    assert not access.holds(held)


def test_the_file_is_its_owner_s_and_holds_no_secret(access: Access, tmp_path: Path) -> None:
    secrets = [access.log_in(PASSWORD, "10.0.0.1", "x"), access.make_token("script"), PASSWORD]
    file = tmp_path / FILE
    assert file.stat().st_mode & 0o777 == 0o600
    text = file.read_text()
    assert "$argon2id$" in text
    assert not any(secret in text for secret in secrets)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: "",
        lambda text: text[:-20],
        lambda text: "{}",
        lambda text: "null",
        lambda text: text.replace("$argon2id$", "$nothing$"),
        lambda text: text.replace('"version": 1', '"version": 2'),
        lambda text: text.replace('"sessions": []', '"sessions": [{"digest": "00"}]'),
        lambda text: text + " " * 1_000_000,
    ],
)
def test_with_a_damaged_file_nobody_gets_in(
    access: Access, tmp_path: Path, spoil: Callable[[str], str]
) -> None:
    secret = access.log_in(PASSWORD, "10.0.0.1", "x")
    held = access.let_in_by_cookie(secret)
    assert held is not None
    access.log_out(held)
    (tmp_path / FILE).write_text(spoil((tmp_path / FILE).read_text()))
    with pytest.raises(AccessFileError, match=re.escape(FILE)):
        Access.open(tmp_path)
    with pytest.raises(AccessFileError):
        access.has_password  # noqa: B018
    with pytest.raises(AccessFileError):
        access.log_in(PASSWORD, "10.0.0.1", "x")
    with pytest.raises(AccessFileError):
        access.set_password(PASSWORD)
    assert access.let_in_by_cookie(secret) is None
    access.forget_password()
    assert access.is_open()


def test_a_folder_in_the_file_s_place_is_an_error_too(tmp_path: Path) -> None:
    (tmp_path / FILE).mkdir()
    with pytest.raises(AccessFileError):
        Access.open(tmp_path)


def test_another_password_ends_every_session_but_no_token(access: Access) -> None:
    session = access.log_in(PASSWORD, "10.0.0.1", "x")
    token, key = access.make_token("script"), access.one_time_key()
    access.change_password(PASSWORD, "something else", "10.0.0.1", "x")
    assert access.let_in_by_cookie(session) is None
    assert access.let_in_by_token(token) is not None
    with pytest.raises(KeyRefused):
        access.log_in_with_key(key, "x")
    with pytest.raises(WrongPassword):
        access.change_password(PASSWORD, "something new", "10.0.0.1", "x")


def test_an_expired_session_is_none_and_is_not_kept(access: Access, tmp_path: Path) -> None:
    secret = access.log_in(PASSWORD, "10.0.0.1", "x")
    content = json.loads((tmp_path / FILE).read_text())
    content["sessions"][0]["expires"] = (datetime.now(UTC) - timedelta(seconds=1)).isoformat()
    (tmp_path / FILE).write_text(json.dumps(content))
    later = Access.open(tmp_path)
    assert later.let_in_by_cookie(secret) is None
    assert later.sessions() == []
    later.make_token("script")
    assert json.loads((tmp_path / FILE).read_text())["sessions"] == []


def test_who_logs_in_last_is_let_in_though_the_clock_was_set_back(access: Access, tmp_path: Path) -> None:
    access.log_in(PASSWORD, "10.0.0.1", "x")
    content = json.loads((tmp_path / FILE).read_text())
    ahead = {
        name: (datetime.fromisoformat(content["sessions"][0][name]) + timedelta(days=400)).isoformat()
        for name in ("created", "last_seen", "expires")
    }
    first = content["sessions"][0] | ahead
    content["sessions"] = [first | {"digest": f"{number:064x}"} for number in range(MOST_SESSIONS)]
    (tmp_path / FILE).write_text(json.dumps(content))
    secret = access.log_in(PASSWORD, "10.0.0.1", "x")
    assert access.let_in_by_cookie(secret) is not None
    assert len(access.sessions()) == MOST_SESSIONS


def test_what_another_program_changes_is_noticed(access: Access, tmp_path: Path) -> None:
    other = Access.open(tmp_path, hashing=CHEAP)
    token = other.make_token("script")
    assert [each.name for each in access.tokens()] == ["script"]
    assert access.let_in_by_token(token) is not None
    other.forget_password()
    assert not access.has_password
    assert access.let_in_by_token(token) is None


def test_changes_of_two_programs_at_once_are_all_kept(access: Access, tmp_path: Path) -> None:
    both = (access, Access.open(tmp_path, hashing=CHEAP))
    makers = [
        threading.Thread(target=both[n % 2].make_token, args=(f"script {n}",), daemon=True) for n in range(12)
    ]
    for maker in makers:
        maker.start()
    for maker in makers:
        maker.join()
    assert len(both[0].tokens()) == len(both[1].tokens()) == 12


def test_tokens_have_names_and_end(access: Access) -> None:
    secret = access.make_token("  my   script ")
    assert [(each.name, each.last_used) for each in access.tokens()] == [("my script", None)]
    assert access.let_in_by_cookie(secret) is None
    held = access.let_in_by_token(secret)
    assert held is not None
    assert held.kind is Kind.TOKEN
    assert access.tokens()[0].last_used is not None
    for wrong in ("my script", "", "x" * 81, "a\x00b"):
        with pytest.raises(OptionError):
            access.make_token(wrong)
    access.end_token("my script")
    assert not access.holds(held)
    with pytest.raises(NotThere):
        access.end_token("my script")


def test_when_somebody_was_seen_last_survives_the_server(access: Access, tmp_path: Path) -> None:
    secret = access.make_token("script")
    access.let_in_by_token(secret)
    assert Access.open(tmp_path).tokens()[0].last_used is None
    access.save_seen()
    assert Access.open(tmp_path).tokens()[0].last_used is not None


def test_a_one_time_key_opens_once(access: Access) -> None:
    key = access.one_time_key()
    assert access.let_in_by_cookie(access.log_in_with_key(key, "phone")) is not None
    for wrong in (key, "", "x" * 100):
        with pytest.raises(KeyRefused):
            access.log_in_with_key(wrong, "phone")


def test_a_one_time_key_ends_after_ten_minutes_and_when_there_are_many() -> None:
    clock = Clock()
    keys = OneTimeKeys(clock)
    old, *others = [keys.make() for _ in range(21)]
    assert not keys.use(old)
    assert keys.use(others[0])
    clock.now_s += 600.0
    assert not keys.use(others[1])


def test_a_made_password_may_be_typed_as_phones_do(tmp_path: Path) -> None:
    access = Access.open(tmp_path, hashing=CHEAP)
    password = access.make_password()
    assert re.fullmatch(r"([a-z]{4}-){3}[a-z]{4}", password)
    assert not set(password) & set("ilo01")
    for spelling in (password, password.title(), password.replace("-", " "), password.replace("-", "")):
        access.log_in(spelling, "10.0.0.1", "x")
    assert len({made_password() for _ in range(50)}) == 50


@pytest.mark.parametrize("password", ["", "short", "aaaaaaaaaaaa", "with\nline feed", "x y" * 100])
def test_a_password_that_protects_little_is_not_taken(access: Access, password: str) -> None:
    with pytest.raises(PasswordUnfit):
        access.set_password(password)
    access.log_in(PASSWORD, "10.0.0.1", "x")


def test_each_wrong_attempt_from_an_address_makes_the_next_wait_longer() -> None:
    clock = Clock()
    attempts = Attempts(clock)
    waits = []
    for _ in range(Attempts.each.free + 12):
        try:
            attempts.begin("10.0.0.1")
        except TooManyAttempts as error:
            waits.append(error.wait_s)
            attempts.begin("10.0.0.2")
            attempts.succeeded("10.0.0.2")
            clock.now_s += error.wait_s
            attempts.begin("10.0.0.1")
    assert waits[:4] == [1, 2, 4, 8]
    assert waits[-1] == Attempts.each.longest_s
    clock.now_s += Attempts.each.forgets_s
    attempts.begin("10.0.0.1")
    attempts.begin("10.0.0.1")


def test_many_addresses_together_wait_but_not_one_that_has_logged_in() -> None:
    clock = Clock()
    attempts = Attempts(clock)
    attempts.begin("10.9.9.9")
    attempts.succeeded("10.9.9.9")
    for number in range(Attempts.together.free):
        attempts.begin(f"10.0.0.{number}")
    with pytest.raises(TooManyAttempts):
        attempts.begin("10.1.1.1")
    attempts.begin("10.9.9.9")
    for number in range(3000):
        clock.now_s += 31.0
        attempts.begin(f"10.2.{number // 250}.{number % 250}")
    assert len(attempts._by_address) <= 1000


def test_who_has_one_address_of_version_6_has_its_whole_network() -> None:
    attempts = Attempts(Clock())
    for number in range(Attempts.each.free):
        attempts.begin(f"2001:db8::{number:x}")
    with pytest.raises(TooManyAttempts):
        attempts.begin("2001:db8::ffff")
    attempts.begin("2001:db8:1::1")
    attempts.begin("::ffff:10.0.0.1")
    attempts.begin("fe80::1%eth0")


def test_attempts_at_the_same_time_gain_nothing(tmp_path: Path) -> None:
    attempts = Attempts(Clock())
    access = Access.open(tmp_path, hashing=CHEAP, attempts=attempts)
    access.set_password(PASSWORD)
    told: list[type[Exception]] = []

    def attempt() -> None:
        try:
            access.log_in("wrong password", "10.0.0.1", "x")
        except (WrongPassword, TooManyAttempts) as error:
            told.append(type(error))

    tries = [threading.Thread(target=attempt, daemon=True) for _ in range(40)]
    for each in tries:
        each.start()
    for each in tries:
        each.join()
    assert len(told) == 40
    assert told.count(WrongPassword) <= Attempts.each.free
