from npend_gym.play.game import MAX_N as MAX_N
from npend_gym.play.game import Game as Game
from npend_gym.play.game import play as play
