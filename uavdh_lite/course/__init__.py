"""What a course needs: quizzes, the exercises' checks, the challenge."""
