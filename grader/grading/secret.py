"""The course's secret: a file that chooses the hidden episodes, and the name that a record knows it by."""

import hashlib
import hmac
import os
import secrets

from grader.assignment import PUBLIC_SECRET

#: Random bytes of a new secret; bytes and different bytes a secret must have; bytes of a file that is no secret.
RANDOM, FEWEST, DIFFERENT, MOST = 32, 16, 5, 4096
_MAKE = "grader secret new FILE"


class SecretError(ValueError):
    """A secret cannot be had from, or put into, a file; one line that says what to do."""


def new_secret(path):
    """Write a new secret, readable by its owner alone; a file that exists is left as it is.

    Parameters
    ----------
    path : Path

    Returns
    -------
    bytes
        What `read_secret` will make of the file: hexadecimal digits, which survive an editor and an e-mail.

    Raises
    ------
    SecretError
    """
    key = secrets.token_hex(RANDOM).encode()
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise SecretError(f"{path} exists and is left as it is: name a new file for a new secret") from None
    except FileNotFoundError:
        raise SecretError(f"cannot write {path}: there is no folder {path.parent}; make it first") from None
    except OSError as error:
        raise SecretError(f"cannot write {path}: {error.strerror}") from None
    try:
        with open(handle, "wb") as file:
            file.write(key + b"\n")
    except OSError as error:
        path.unlink()
        raise SecretError(f"cannot write {path}: {error.strerror}") from None
    return key


def read_secret(path):
    """The secret in a file, whose last line may end or not.

    Parameters
    ----------
    path : Path

    Returns
    -------
    bytes

    Raises
    ------
    SecretError
        There is none, or one that could be guessed.
    """
    try:
        with open(path, "rb") as file:
            key = file.read(MOST + 1)
    except OSError as error:
        raise SecretError(f"cannot read the secret {path}: {error.strerror}") from None
    if len(key) > MOST:
        raise SecretError(f"the secret {path} has more than {MOST} bytes: it is some other file; make one: {_MAKE}")
    key = key.rstrip(b"\r\n")
    if len(key) < FEWEST:
        raise SecretError(f"the secret {path} has {len(key)} bytes and needs at least {FEWEST} random ones: {_MAKE}")
    if len(set(key)) < DIFFERENT:
        words = "one byte" if len(set(key)) == 1 else f"{len(set(key))} bytes"
        raise SecretError(f"the secret {path} only repeats {words}: it could be guessed; make a random one: {_MAKE}")
    return key


def fingerprint(secret):
    """What a record calls a secret, so that a grade can be repeated with the right one.

    Parameters
    ----------
    secret : bytes

    Returns
    -------
    str
        "public" for the one everybody knows; else 12 hexadecimal digits, HMAC-SHA256 of a label that no seed is made
        of: they tell nothing about the secret's digest or its seeds.
    """
    if secret == PUBLIC_SECRET:
        return "public"
    return hmac.digest(secret, b"fingerprint of the course's secret", hashlib.sha256).hex()[:12]
