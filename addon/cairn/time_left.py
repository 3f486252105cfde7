"""The time left of a bake, and times in words."""

# The time left is unknown if a new estimate exceeds the last one by this factor and this many seconds.
DOUBT = 1.5, 3.0


class TimeLeft:
    """The time left of a stage, as a person sees it: it only falls, or it is unknown."""

    def __init__(self):
        self.stage = self.end = None
        self.is_doubted = False

    def hear(self, stage, seconds, now):
        """The latest estimate; None before there is one."""
        if stage != self.stage:
            self.stage, self.end, self.is_doubted = stage, None, False
        if seconds is None:
            return
        if self.end is None or now + seconds <= self.end:
            self.end, self.is_doubted = now + seconds, False
        else:
            factor, more = DOUBT
            self.is_doubted = seconds > factor * max(self.end - now, 0.0) + more

    def remaining(self, now):
        """Seconds; None if they are not known."""
        return None if self.end is None or self.is_doubted else max(self.end - now, 0.0)


def duration(seconds):
    seconds = round(seconds)
    if seconds < 60:
        return f"{seconds} s"
    minutes, seconds = divmod(seconds, 60)
    return f"{minutes}:{seconds:02} min" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02} h"
