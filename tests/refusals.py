"""How what users give is refused: by one short ValueError, whatever it is."""


def short(message):
    return len(message.splitlines()) <= 10 and len(message) < 1000


def refusal(function, *arguments):
    """The message of the ValueError that a call raises, or None; any other error is one of the test."""
    try:
        function(*arguments)
    except ValueError as error:
        return str(error)
    return None
